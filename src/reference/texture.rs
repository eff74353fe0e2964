//! Texture look-ups. sRGB is decoded before filtering; there are no mipmaps.

use glam::{Vec2, Vec3, Vec4};

use crate::scene::{Color, Filter, Image, Scalar, Scene, Texture, TextureRef, Wrap};

/// The images and samplers of a scene.
pub struct Textures<'s> {
    images: &'s [Image],
    textures: &'s [Texture],
    /// Linear value of each 8-bit sRGB code.
    linear_from_srgb: [f32; 256],
}

impl<'s> Textures<'s> {
    /// Borrows the scene's textures.
    #[must_use]
    pub fn new(scene: &'s Scene) -> Self {
        // IEC 61966-2-1.
        let decode = |code: usize| {
            let e = code as f64 / 255.0;
            (if e <= 0.04045 { e / 12.92 } else { ((e + 0.055) / 1.055).powf(2.4) }) as f32
        };
        Self { images: &scene.images, textures: &scene.textures, linear_from_srgb: std::array::from_fn(decode) }
    }

    /// Returns a colour at a surface's texture coordinates.
    #[must_use]
    pub fn color(&self, color: &Color, uvs: [Vec2; 2]) -> Vec3 {
        color.texture.map_or(color.factor, |t| color.factor * self.fetch(&t, uvs).truncate())
    }

    /// Returns a scalar at a surface's texture coordinates.
    #[must_use]
    pub fn scalar(&self, scalar: &Scalar, uvs: [Vec2; 2]) -> f32 {
        scalar.texture.map_or(scalar.factor, |(t, channel)| scalar.factor * self.fetch(&t, uvs)[channel as usize & 3])
    }

    /// Returns linear RGBA at a surface's texture coordinates.
    #[must_use]
    pub fn fetch(&self, reference: &TextureRef, uvs: [Vec2; 2]) -> Vec4 {
        let texture = &self.textures[reference.texture];
        let image = &self.images[texture.image];
        let size = Vec2::new(image.width as f32, image.height as f32);
        let at = reference.apply(uvs) * size;
        match texture.filter {
            Filter::Nearest => self.texel(texture, image, at.floor()),
            Filter::Linear => {
                let corner = (at - 0.5).floor();
                let f = (at - 0.5) - corner;
                let texel = |x: f32, y: f32| self.texel(texture, image, corner + Vec2::new(x, y));
                let above = texel(0.0, 0.0) * (1.0 - f.x) + texel(1.0, 0.0) * f.x;
                let below = texel(0.0, 1.0) * (1.0 - f.x) + texel(1.0, 1.0) * f.x;
                above * (1.0 - f.y) + below * f.y
            }
        }
    }

    fn texel(&self, texture: &Texture, image: &Image, at: Vec2) -> Vec4 {
        let x = wrap(at.x, image.width, texture.wrap[0]);
        let y = wrap(at.y, image.height, texture.wrap[1]);
        self.decode(texture, image.texels[y * image.width as usize + x])
    }

    fn decode(&self, texture: &Texture, texel: [u8; 4]) -> Vec4 {
        let [r, g, b, a] = texel;
        let alpha = f32::from(a) / 255.0;
        if texture.srgb {
            let [r, g, b] = [r, g, b].map(|code| self.linear_from_srgb[code as usize]);
            Vec4::new(r, g, b, alpha)
        } else {
            Vec4::new(f32::from(r), f32::from(g), f32::from(b), 0.0) / 255.0 + Vec4::new(0.0, 0.0, 0.0, alpha)
        }
    }
}

/// Maps an integer texel coordinate into the image by the wrap mode. NaN maps to 0.
fn wrap(at: f32, size: u32, mode: Wrap) -> usize {
    // Beyond 2^30 f32 coordinates have no fractional precision left; the clamp keeps the arithmetic in range.
    let at = at.clamp(-1_073_741_824.0, 1_073_741_824.0) as i64;
    let size = i64::from(size);
    (match mode {
        Wrap::Repeat => at.rem_euclid(size),
        Wrap::Clamp => at.clamp(0, size - 1),
        Wrap::Mirror => {
            let folded = at.rem_euclid(2 * size);
            folded.min(2 * size - 1 - folded)
        }
    }) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene(filter: Filter, wrap: Wrap, srgb: bool) -> Scene {
        let texels = vec![[0, 0, 0, 255], [255, 0, 0, 255], [0, 255, 0, 255], [128, 0, 0, 0]];
        Scene {
            images: vec![Image { name: String::new(), width: 2, height: 2, texels }],
            textures: vec![Texture { image: 0, wrap: [wrap; 2], filter, srgb }],
            ..Scene::default()
        }
    }

    fn fetch(scene: &Scene, u: f32, v: f32) -> Vec4 {
        Textures::new(scene).fetch(&TextureRef::new(0), [Vec2::new(u, v), Vec2::ZERO])
    }

    #[test]
    fn wrap_modes() {
        let folded = |mode| [-3, -2, -1, 0, 1, 2, 3, 4].map(|i| wrap(i as f32, 2, mode));
        assert_eq!(folded(Wrap::Repeat), [1, 0, 1, 0, 1, 0, 1, 0]);
        assert_eq!(folded(Wrap::Clamp), [0, 0, 0, 0, 1, 1, 1, 1]);
        assert_eq!(folded(Wrap::Mirror), [1, 1, 0, 0, 1, 1, 0, 0]);
        assert_eq!(wrap(f32::NAN, 2, Wrap::Repeat), 0);
        assert_eq!(wrap(f32::INFINITY, 2, Wrap::Clamp), 1);
    }

    #[test]
    fn filters() {
        let nearest = scene(Filter::Nearest, Wrap::Repeat, false);
        assert_eq!(fetch(&nearest, 0.99, 0.01), Vec4::new(1.0, 0.0, 0.0, 1.0));
        assert_eq!(fetch(&nearest, 0.01, -0.01), Vec4::new(0.0, 1.0, 0.0, 1.0));
        let linear = scene(Filter::Linear, Wrap::Clamp, false);
        // At a texel centre the result is that texel; halfway between two it is their mean; outside, the edge
        // is repeated.
        assert_eq!(fetch(&linear, 0.75, 0.25), Vec4::new(1.0, 0.0, 0.0, 1.0));
        assert_eq!(fetch(&linear, 0.5, 0.0), Vec4::new(0.5, 0.0, 0.0, 1.0));
        let repeat = scene(Filter::Linear, Wrap::Repeat, false);
        assert_eq!(fetch(&repeat, 0.0, 0.25), Vec4::new(0.5, 0.0, 0.0, 1.0));
    }

    #[test]
    fn srgb_is_decoded_before_filtering_and_alpha_never() {
        let srgb = scene(Filter::Linear, Wrap::Clamp, true);
        let code = fetch(&srgb, 0.75, 0.75);
        assert!((code.x - 0.215_861).abs() < 1e-5 && code.w == 0.0, "{code}");
        let between = fetch(&srgb, 0.75, 0.5);
        assert!((between.x - (1.0 + 0.215_861) / 2.0).abs() < 1e-5 && (between.w - 0.5).abs() < 1e-6, "{between}");
    }
}
