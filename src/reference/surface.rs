//! Surface interactions: position, normals and material at a hit.

use glam::{Vec2, Vec3};

use super::bsdf::{Bsdf, Prepared};
use super::bvh::Hit;
use super::layers::{Coat, Layered};
use super::microfacet::Shape;
use super::sampler::hash;
use super::sheen::Sheen;
use super::texture::Textures;
use crate::scene::model::geometry::Vertex;
use crate::scene::{Anisotropy, Boundary, Geometry, Material, NormalMap, Opacity, Scene, Sides, TextureRef};

/// An orthonormal basis around a shading normal.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    x: Vec3,
    y: Vec3,
    /// The shading normal.
    pub z: Vec3,
}

impl Frame {
    /// The coordinate axes.
    pub const UP: Self = Self { x: Vec3::X, y: Vec3::Y, z: Vec3::Z };

    /// Builds a basis around a unit vector (Duff et al., JCGT 2017).
    #[must_use]
    pub fn new(z: Vec3) -> Self {
        let sign = 1.0_f32.copysign(z.z);
        let a = -1.0 / (sign + z.z);
        let b = z.x * z.y * a;
        Self {
            x: Vec3::new(1.0 + sign * z.x * z.x * a, sign * b, -sign * z.x),
            y: Vec3::new(b, sign + z.y * z.y * a, -z.y),
            z,
        }
    }

    /// Builds a basis around a unit vector whose x is nearest to a direction; none if they are parallel.
    #[must_use]
    pub fn along(z: Vec3, direction: Vec3) -> Option<Self> {
        let x = (direction - z * z.dot(direction)).try_normalize()?;
        Some(Self { x, y: z.cross(x), z })
    }

    /// Transforms a vector from world space into the basis.
    #[must_use]
    pub fn local(&self, w: Vec3) -> Vec3 {
        Vec3::new(w.dot(self.x), w.dot(self.y), w.dot(self.z))
    }

    /// Transforms a vector from the basis into world space.
    #[must_use]
    pub fn world(&self, w: Vec3) -> Vec3 {
        self.x * w.x + self.y * w.y + self.z * w.z
    }
}

/// A point on a surface, seen from one side.
pub struct Surface<'s> {
    /// Position on the triangle, world space.
    pub position: Vec3,
    /// Unit geometric normal on the viewer's side.
    pub normal: Vec3,
    /// Basis around the shading normal on the viewer's side; x is the direction in which a lobe is stretched.
    pub frame: Frame,
    /// Strength of the lobe's stretch.
    pub anisotropy: f32,
    /// Normal of the coat on the viewer's side; without one, that of the mesh.
    pub coat_normal: Vec3,
    /// True if the viewer sees the counter-clockwise side.
    pub front: bool,
    /// Both sets of texture coordinates.
    pub uvs: [Vec2; 2],
    /// Interpolated vertex colour without alpha.
    pub vertex_color: Vec3,
    /// Index of the material, of mixes that of the part that the point is of, and the material.
    pub material: (usize, &'s Material),
    /// The colour channel that a dispersive medium refracts; green unless it is chosen.
    pub channel: usize,
    /// The material as a whole.
    whole: &'s Material,
}

/// Least cosine of the angle between a shading normal and the camera's direction.
const LEAST_FACING: f32 = 0.01;

/// Returns a unit normal, bent towards a unit direction until it faces it.
fn turned_towards(normal: Vec3, w: Vec3) -> Vec3 {
    let cosine = normal.dot(w);
    if cosine >= LEAST_FACING { normal } else { (normal + w * (LEAST_FACING - cosine)).normalize() }
}

impl Surface<'_> {
    /// Returns the surface as the camera sees it, in the unit direction `wo` on the viewer's side. Along silhouettes of coarse meshes,
    /// and in normal maps, shading normals face away from the camera, which would be black: they are bent until they face it.
    #[must_use]
    pub fn seen_along(self, wo: Vec3) -> Self {
        let normal = turned_towards(self.frame.z, wo);
        let stretched = || Frame::along(normal, self.frame.x).filter(|_| self.anisotropy > 0.0);
        let frame = if normal == self.frame.z { self.frame } else { stretched().unwrap_or_else(|| Frame::new(normal)) };
        Self { frame, coat_normal: turned_towards(self.coat_normal, wo), ..self }
    }

    /// Returns true if rays pass the surface by what it transmits in every colour.
    #[must_use]
    pub fn is_clear_sheet(&self) -> bool {
        self.whole.is_clear_sheet()
    }

    /// Returns true if scattering between the viewer and a direction with the cosine `wi_z` to the shading normal
    /// depends on the channel: if one of them is inside a medium that disperses light.
    #[must_use]
    pub fn disperses(&self, wi_z: f32) -> bool {
        self.material.1.iors().is_some() && (!self.front || wi_z < 0.0)
    }

    /// Returns the absorption coefficients on the viewer's side and on the far side, 1/m; `viewer` is that of
    /// the path's current medium.
    #[must_use]
    pub fn media(&self, viewer: Vec3) -> [Vec3; 2] {
        match self.whole.boundary {
            Boundary::Volume { absorption } if self.whole.transmits() => {
                if self.front {
                    [viewer, absorption]
                } else {
                    [absorption, Vec3::ZERO]
                }
            }
            _ => [viewer; 2],
        }
    }
}

/// Triangles and materials, prepared for shading.
pub struct Surfaces<'s> {
    /// World-space triangles.
    pub geometry: Geometry,
    /// Instance of each vertex, and its vertex in the mesh. Vertices of tessellated surfaces come after these.
    pub origins: Vec<[u32; 2]>,
    /// Unit geometric normals of the triangles, front side.
    pub normals: Vec<Vec3>,
    /// Textures of the materials.
    pub textures: Textures<'s>,
    materials: &'s [Material],
    /// For each material whether vertices on it may count as no bounces.
    specular: Vec<bool>,
    /// The materials and the parts of those that are mixes, each with the places of its own parts.
    parts: Vec<(&'s Material, Option<[usize; 2]>)>,
    prepared: Vec<Prepared>,
}

impl<'s> Surfaces<'s> {
    /// Flattens a scene.
    #[must_use]
    pub fn new(scene: &'s Scene) -> Self {
        let (geometry, origins) = Geometry::with_origins(scene);
        let normal = |i| {
            let [a, b, c] = geometry.positions(i);
            (b - a).cross(c - a).normalize_or_zero()
        };
        let parts = Material::with_parts(&scene.materials);
        Self {
            origins: origins.iter().map(|origin| [origin.instance, origin.vertex]).collect(),
            normals: (0..geometry.triangles.len()).map(normal).collect(),
            prepared: parts.iter().map(|(m, _)| Prepared::new(m)).collect(),
            parts,
            textures: Textures::new(scene),
            materials: &scene.materials,
            specular: scene.materials.iter().map(Material::is_specular).collect(),
            geometry,
        }
    }

    /// Returns the material of a triangle.
    #[must_use]
    pub fn material(&self, triangle: u32) -> &'s Material {
        &self.materials[self.geometry.materials[triangle as usize] as usize]
    }

    /// Returns true if vertices on a triangle may count as no bounces.
    #[must_use]
    pub fn is_specular(&self, triangle: u32) -> bool {
        self.specular[self.geometry.materials[triangle as usize] as usize]
    }

    /// Returns the probability that a triangle stops a ray at a hit: 0 where an alpha mask cuts it out.
    #[must_use]
    pub fn opacity(&self, hit: &Hit) -> f32 {
        let Some(opacity) = &self.material(hit.triangle).opacity else { return 1.0 };
        let corners = self.corners(hit.triangle);
        let alpha = self.textures.scalar(opacity.value(), self.uvs(hit)) * hit.mix(corners.map(|c| c.color.w));
        match *opacity {
            Opacity::CutOut { cutoff, .. } => f32::from(alpha >= cutoff),
            Opacity::Blended { .. } => alpha.clamp(0.0, 1.0),
        }
    }

    /// Returns the probability that a triangle stops a ray in a direction: clear sheets let the rest pass straight on.
    #[must_use]
    pub fn stopping(&self, hit: &Hit, direction: Vec3) -> f32 {
        let opacity = self.opacity(hit);
        let index = self.geometry.materials[hit.triangle as usize] as usize;
        let material = &self.materials[index];
        if opacity == 0.0 || !material.is_clear_sheet() {
            return opacity;
        }
        let surface = self.at(hit, direction, 0);
        let base = Bsdf::new(material, &self.prepared[index], &self.textures, &surface);
        opacity * (1.0 - base.straight(surface.frame.z.dot(direction.normalize()).abs().min(1.0)))
    }

    /// Returns true if a hit counts without chance: blended surfaces do where their opacity is at least 0.5.
    #[must_use]
    pub fn solid(&self, hit: &Hit) -> bool {
        self.opacity(hit) >= 0.5
    }

    /// Returns the texture coordinates at a hit.
    #[must_use]
    pub fn uvs(&self, hit: &Hit) -> [Vec2; 2] {
        let corners = self.corners(hit.triangle);
        [0, 1].map(|set| hit.mix(corners.map(|c| c.uvs[set])))
    }

    /// Returns the radiance that a triangle emits at a hit, on its front or its back side.
    #[must_use]
    pub fn emitted(&self, hit: &Hit, front: bool) -> Vec3 {
        match &self.material(hit.triangle).emission {
            Some(emission) if front || emission.two_sided => match &emission.radiance.texture {
                Some(_) => self.textures.color(&emission.radiance, self.uvs(hit)),
                None => emission.radiance.factor,
            },
            _ => Vec3::ZERO,
        }
    }

    fn corners(&self, triangle: u32) -> [&Vertex; 3] {
        self.geometry.triangles[triangle as usize].map(|i| &self.geometry.vertices[i as usize])
    }

    /// Returns the place of the part that a hit is of: each with the probability of its share, by random bits of the
    /// ray.
    fn part(&self, hit: &Hit, bits: u32) -> usize {
        let mut part = self.geometry.materials[hit.triangle as usize] as usize;
        while let (Material { mix: Some(mix), .. }, Some(parts)) = self.parts[part] {
            let weight = self.textures.scalar(&mix.weight, self.uvs(hit));
            let chance = hash(hash(bits ^ 0x68bc_21eb) ^ hash(part as u32)) as f32 / u32::MAX as f32;
            part = parts[usize::from(chance < weight)];
        }
        part
    }

    /// Returns the surface at a hit of a ray along `direction`. Random bits of the ray choose the parts of mixes.
    #[must_use]
    pub fn at(&self, hit: &Hit, direction: Vec3, bits: u32) -> Surface<'s> {
        let corners = self.corners(hit.triangle);
        let flat = self.normals[hit.triangle as usize];
        let front = flat.dot(direction) < 0.0;
        let side = if front { 1.0 } else { -1.0 };
        let uvs = self.uvs(hit);
        let smooth = hit.mix(corners.map(|c| c.normal)).try_normalize().unwrap_or(flat);
        let index = self.part(hit, bits);
        let (material, _) = self.parts[index];
        // The tangent along u, or the mesh's own, with the sign of the bitangent.
        let tangent = |texture: Option<TextureRef>| {
            let own = hit.mix(corners.map(|c| c.tangent.truncate()));
            match corners[0].tangent.w {
                0.0 => {
                    let set = texture.map_or(0, |texture| texture.uv_set as usize & 1);
                    tangent_from_uv(corners.map(|c| c.position), corners.map(|c| c.uvs[set]), smooth)
                }
                handedness => Some((own, handedness)),
            }
        };
        let bent = |map: &Option<NormalMap>| {
            let Some(map) = map else { return smooth };
            tangent(Some(map.texture))
                .map_or(smooth, |(tangent, handedness)| bend(map, &self.textures, uvs, smooth, tangent, handedness))
        };
        let shading = bent(&material.normal_map);
        let coat = material.coat.as_ref().map_or(smooth, |coat| bent(&coat.normal_map));
        let normal = shading * side;
        let stretched = material.anisotropy.as_ref().and_then(|anisotropy| {
            let (tangent, handedness) = tangent(anisotropy.texture)?;
            let (direction, strength) = stretch(anisotropy, &self.textures, uvs);
            let Frame { x, y, .. } = Frame::along(smooth, tangent)?;
            let frame = Frame::along(normal, x * direction.x + y * (handedness * direction.y))?;
            (strength > 0.0).then_some((frame, strength))
        });
        let (frame, anisotropy) = stretched.unwrap_or_else(|| (Frame::new(normal), 0.0));
        Surface {
            position: hit.mix(corners.map(|c| c.position)),
            normal: flat * side,
            frame,
            anisotropy,
            coat_normal: coat * side,
            front,
            uvs,
            vertex_color: hit.mix(corners.map(|c| c.color.truncate())),
            material: (index, material),
            channel: 1,
            whole: self.material(hit.triangle),
        }
    }

    /// Returns the BSDF of a surface with the layers on top of it; none for the black back of a one-sided
    /// material.
    #[must_use]
    pub fn bsdf(&self, surface: &Surface) -> Option<Layered<'_>> {
        let (index, material) = surface.material;
        let counts = surface.front || material.sides == Sides::Two || material.transmits();
        let base = || Bsdf::new(material, &self.prepared[index], &self.textures, surface);
        let base = || if surface.anisotropy > 0.0 { base().roughened() } else { base() };
        counts.then(base).map(|base| Layered {
            shape: Shape {
                stretch: base
                    .alpha()
                    .map_or(1.0, |alpha| (Anisotropy::width(surface.anisotropy, alpha) / alpha).max(1.0)),
                distribution: material.distribution,
            },
            base,
            sheen: material.sheen.as_ref().map(|sheen| Sheen::new(sheen, &self.textures, surface)),
            coat: material.coat.as_ref().map(|coat| Coat::new(coat, &self.textures, surface)),
        })
    }
}

/// Returns the direction of increasing u, and the sign for which normal x tangent points up the image (v
/// points down).
fn tangent_from_uv(p: [Vec3; 3], uv: [Vec2; 3], normal: Vec3) -> Option<(Vec3, f32)> {
    let (p1, p2) = (p[1] - p[0], p[2] - p[0]);
    let (t1, t2) = (uv[1] - uv[0], uv[2] - uv[0]);
    let det = t1.perp_dot(t2);
    if det == 0.0 {
        return None;
    }
    let along_u = (p1 * t2.y - p2 * t1.y) / det;
    let up = (p1 * t2.x - p2 * t1.x) / det;
    Some((along_u, 1.0_f32.copysign(normal.cross(along_u).dot(up))))
}

/// Returns the direction of a lobe's stretch in terms of tangent and bitangent, and its strength.
fn stretch(anisotropy: &Anisotropy, textures: &Textures, uvs: [Vec2; 2]) -> (Vec2, f32) {
    let rotation = Vec2::from_angle(anisotropy.rotation);
    let Some(texture) = &anisotropy.texture else { return (rotation, anisotropy.strength) };
    let texel = textures.fetch(texture, uvs).truncate();
    (rotation.rotate(texel.truncate() * 2.0 - 1.0), anisotropy.strength * texel.z)
}

/// Applies a normal map; the shading normal stays where the result is degenerate.
fn bend(map: &NormalMap, textures: &Textures, uvs: [Vec2; 2], normal: Vec3, tangent: Vec3, handedness: f32) -> Vec3 {
    let texel = textures.fetch(&map.texture, uvs).truncate() * 2.0 - 1.0;
    let Some(tangent) = (tangent - normal * normal.dot(tangent)).try_normalize() else { return normal };
    let bitangent = normal.cross(tangent) * handedness;
    let bent = tangent * (texel.x * map.scale) + bitangent * (texel.y * map.scale) + normal * texel.z;
    bent.try_normalize().unwrap_or(normal)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_orthonormal() {
        for z in [Vec3::Z, Vec3::NEG_Z, Vec3::X, Vec3::new(0.3, -0.5, -0.8).normalize()] {
            let f = Frame::new(z);
            for (a, b, expected) in
                [(f.x, f.x, 1.0), (f.y, f.y, 1.0), (f.x, f.y, 0.0), (f.x, f.z, 0.0), (f.y, f.z, 0.0)]
            {
                assert!((a.dot(b) - expected).abs() < 1e-6, "{f:?}");
            }
            let w = Vec3::new(0.1, 0.7, -0.2);
            assert!(f.world(f.local(w)).distance(w) < 1e-6);
        }
    }

    #[test]
    fn tangents_follow_u_and_bitangents_go_up_the_image() {
        // A quad in the xy plane with the image upright: u is along +x and v down, so that up the image is
        // +y.
        let p = [Vec3::ZERO, Vec3::X, Vec3::Y];
        let uv = [Vec2::new(0.0, 1.0), Vec2::new(1.0, 1.0), Vec2::new(0.0, 0.0)];
        let (tangent, handedness) = tangent_from_uv(p, uv, Vec3::Z).unwrap();
        assert!(tangent.distance(Vec3::X) < 1e-6);
        assert!((Vec3::Z.cross(tangent) * handedness).distance(Vec3::Y) < 1e-6);
        // Mirroring u reverses the tangent and keeps the bitangent.
        let uv = uv.map(|t| Vec2::new(-t.x, t.y));
        let (tangent, handedness) = tangent_from_uv(p, uv, Vec3::Z).unwrap();
        assert!(tangent.distance(Vec3::NEG_X) < 1e-6);
        assert!((Vec3::Z.cross(tangent) * handedness).distance(Vec3::Y) < 1e-6);
        assert!(tangent_from_uv(p, [Vec2::ZERO; 3], Vec3::Z).is_none());
    }
}
