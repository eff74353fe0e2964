//! The light table: punctual lights, emissive triangles and the environment, with the probability that each
//! is chosen (shaders/lib/lights/light.wesl).
//!
//! These three kinds are groups. The probability of a group is half proportional to its power and half
//! uniform, since a strong sun may be occluded from the visible surfaces. Within a group, probabilities are
//! proportional to power.

use std::f32::consts::PI;

use glam::{Mat3, Vec2, Vec3};

use crate::render::layouts::light_kind::{AREA, DIRECTIONAL, POINT, SKY, SPOT};
use crate::render::layouts::{LightNode, LightRecord, Lighting};
use crate::render::lights::aims::Aims;
use crate::scene::model::emitter::{Emitter, Part, emitters, part};
use crate::scene::{
    EnvironmentMap, Geometry, LUMINANCE, Lamp, Light, Mapping, Pattern, Rows, Scene, SpotFalloff, versine,
};

/// The selection of emitters: lights that paths from the camera can hit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hittable {
    /// All emitters can be chosen.
    All,
    /// All emitters can be chosen except a constant environment, which BSDF sampling samples as well.
    ButConstantSky,
    /// No emitter can be chosen; they are only hit.
    Never,
}

/// Probabilities are multiples of 1 / STEPS, and at least 1 / STEPS for lights with power.
const STEPS: f64 = (1 << 24) as f64;

/// The lights in the layout of the shaders.
#[derive(Clone, Default)]
pub struct LightTable {
    /// One record per light, infinite lights last. Without lights one record that is never chosen.
    pub records: Vec<LightRecord>,
    /// Cumulative probabilities.
    pub sums: Vec<f32>,
    /// First light of each triangle, and the number of its parts along a side. Empty if no triangle emits.
    pub emitters: Vec<[u32; 2]>,
    /// Directional patterns of lights (shaders/lib/lights/pattern.wesl).
    pub patterns: Vec<[f32; 4]>,
    /// Cumulative probabilities of an environment map (shaders/lib/lights/sky.wesl): of the bands, then of
    /// the cells within each band.
    pub sky_shares: Vec<f32>,
    /// The light tree; empty without one.
    pub nodes: Vec<LightNode>,
    /// What light paths of caustics are aimed at.
    pub aims: Aims,
    /// Constants of all lights.
    pub lighting: Lighting,
    /// Luminance of the total power, in watts.
    pub power: f32,
    /// Luminance of each light's power, in watts.
    pub powers: Vec<f32>,
    /// Number of local lights.
    pub finite: usize,
}

/// The sampling table of an environment map: bands of cells between rows of texels.
struct SkyTable {
    /// Cumulative probabilities of the bands, then of the cells within each band.
    shares: Vec<f32>,
    bands: u32,
    /// Cells in a band.
    columns: u32,
    /// Integral of luminance times the sine of the polar angle over the unit square.
    integral: f32,
}

impl LightTable {
    /// Builds the table of a scene's lights.
    #[must_use]
    pub fn new(scene: &Scene, geometry: &Geometry, chosen: Hittable) -> Self {
        let (_, radius) = geometry.sphere();
        let disc = PI * radius * radius;
        let mut groups: [Vec<(LightRecord, f32)>; 3] = Default::default();
        let (patterns, first_entries) = flatten(&scene.patterns);
        let entry = |light| (record(light, &scene.patterns, &first_entries), power(light, &scene.patterns, disc));
        groups[0] = scene.lights.iter().map(entry).map(|(record, power)| (record, power.dot(LUMINANCE))).collect();
        let met = if chosen == Hittable::Never { Vec::new() } else { emitters(scene, geometry) };
        for Emitter { triangle, parts, powers } in met {
            groups[1].extend((0..).zip(powers).map(|(index, power)| {
                let Part { corner: [b, c], size } = part(parts, index);
                let position = [b, c, size];
                (LightRecord { kind: AREA, triangle, position, falloff: parts, ..Default::default() }, power)
            }));
        }

        let mut sky = None;
        if let Some(environment) = scene.environment.as_ref().filter(|_| chosen != Hittable::Never) {
            let flux = match &environment.map {
                Some(map) => {
                    sky = SkyTable::new(map);
                    sky.as_ref().map_or(0.0, |s| s.integral * 2.0 * PI * PI)
                }
                None if chosen == Hittable::All => 4.0 * PI,
                None => 0.0,
            };
            let power = flux * environment.radiance.dot(LUMINANCE) * disc;
            if power != 0.0 {
                groups[2].push((LightRecord { kind: SKY, ..Default::default() }, power));
            }
        }
        let lighting = lighting(scene, geometry, sky.as_ref());
        let sky_shares = sky.map_or_else(Vec::new, |sky| sky.shares);
        Self { patterns, ..Self::from_groups(groups, geometry, lighting, sky_shares) }
    }

    /// Returns the probability that a local light is chosen.
    #[must_use]
    pub fn finite_share(&self) -> f32 {
        self.finite.checked_sub(1).map_or(0.0, |last| self.sums[last])
    }

    /// Returns the environment, if it is one of the lights.
    #[must_use]
    pub fn sky(&self) -> Option<&LightRecord> {
        self.records.last().filter(|light| light.kind == SKY)
    }

    /// Returns the number of lights.
    #[must_use]
    pub fn count(&self) -> u32 {
        self.sums.len() as u32
    }

    /// Gives all lights the same probability.
    #[must_use]
    pub fn uniform_selection(mut self) -> Self {
        let probability = 1.0 / self.count().max(1) as f64;
        self.set_probabilities(&vec![probability; self.sums.len()]);
        self
    }

    /// Returns the fixed-point units of splats per unit of radiance, in a scene of a radius in metres: a power of
    /// two, with 32 fractional bits for the mean radiance and 31 bits above it.
    #[must_use]
    pub fn splat_scale(&self, radius: f32) -> f32 {
        let mean = f64::from(self.power) / (4.0 * std::f64::consts::PI.powi(2) * f64::from(radius).powi(2));
        if mean > 0.0 && mean.is_finite() { (32.0 - mean.log2().round()).clamp(-90.0, 90.0).exp2() as f32 } else { 1.0 }
    }

    /// Averages the probabilities with ones proportional to the importance of each light, in any unit.
    pub fn mix_importance(&mut self, importance: &[f32]) {
        let countable = |value: f32| if value.is_finite() { f64::from(value.max(0.0)) } else { 0.0 };
        let total: f64 = importance.iter().copied().map(countable).sum();
        if total > 0.0 {
            let lights = self.records.iter().zip(importance);
            let mixed = lights.map(|(r, &own)| 0.5 * f64::from(r.probability) + 0.5 * countable(own) / total);
            self.set_probabilities(&mixed.collect::<Vec<_>>());
        }
    }

    /// Sets the probabilities, which sum to 1.
    fn set_probabilities(&mut self, probabilities: &[f64]) {
        // Cumulative sums are multiples of a step, so that their differences are exact. Lights with power get
        // at least one step.
        let count = self.powers.iter().filter(|power| **power > 0.0).count() as f64;
        let floor = if count < 0.5 * STEPS { 1.0 } else { 0.0 };
        let (mut sum, mut before) = (0.0_f64, 0.0);
        for (i, &probability) in probabilities.iter().enumerate() {
            sum += probability * (STEPS - floor * count) + if self.powers[i] > 0.0 { floor } else { 0.0 };
            let after = ((sum + 1e-3).floor() / STEPS).min(1.0) as f32;
            self.records[i].probability = after - before;
            self.sums[i] = after;
            before = after;
            if self.records[i].kind == SKY {
                self.lighting.environment_probability = self.records[i].probability;
            }
        }
    }

    /// Chooses a light by a number in [0, 1). None without lights.
    #[must_use]
    pub fn choose(&self, u: f32) -> Option<u32> {
        let last = self.count().checked_sub(1)?;
        Some((self.sums.partition_point(|&sum| sum <= u) as u32).min(last))
    }

    /// Sorts the lights of the groups, with their powers, and sets their probabilities.
    fn from_groups(
        groups: [Vec<(LightRecord, f32)>; 3],
        geometry: &Geometry,
        lighting: Lighting,
        sky_shares: Vec<f32>,
    ) -> Self {
        // Lights with a power that is not finite are chosen as well, so that these values show in the picture
        // and are counted.
        let countable = |power: f32| if power.is_finite() { f64::from(power.max(0.0)) } else { 1.0 };
        let powers: Vec<f64> = groups.iter().map(|g| g.iter().map(|(_, p)| countable(*p)).sum()).collect();
        let total: f64 = powers.iter().sum();
        let group_count = powers.iter().filter(|p| **p > 0.0).count() as f64;
        let mut out = Self { sky_shares, lighting, power: total as f32, ..Self::default() };
        let shares = groups.into_iter().zip(powers).filter(|(_, power)| *power > 0.0).flat_map(|(group, power)| {
            let of_group = 0.5 * power / total + 0.5 / group_count;
            group.into_iter().map(move |(record, own)| (record, countable(own), countable(own) / power * of_group))
        });
        let (mut lights, infinite): (Vec<_>, Vec<_>) = shares.partition(|(record, ..)| !record.is_infinite());
        // Lights are sorted along a Morton curve, so that stratified numbers choose lights that are
        // stratified in space. Parts of a triangle stay together.
        lights.sort_by_key(|(record, ..)| match record.kind {
            AREA => morton_code(geometry.positions(record.triangle as usize).iter().sum::<Vec3>() / 3.0, geometry),
            _ => morton_code(Vec3::from(record.position), geometry),
        });
        out.finite = lights.len();
        lights.extend(infinite);
        let shares: Vec<f64> = lights.iter().map(|(.., share)| *share).collect();
        for (index, (record, power, _)) in (0..).zip(lights) {
            if record.kind == AREA {
                out.emitters.resize(geometry.triangles.len(), [0; 2]);
                let emitter = &mut out.emitters[record.triangle as usize];
                if emitter[1] == 0 {
                    *emitter = [index, record.falloff];
                }
            }
            out.records.push(record);
            out.powers.push(power as f32);
        }
        out.sums = vec![0.0; out.records.len()];
        out.set_probabilities(&shares);
        out.lighting.light_count = out.sums.len() as u32;
        if out.records.is_empty() {
            out.records.push(LightRecord::default());
        }
        out
    }
}

/// Returns the constants of all lights: the bounds of the scene and the environment.
fn lighting(scene: &Scene, geometry: &Geometry, sky: Option<&SkyTable>) -> Lighting {
    let (center, radius) = geometry.sphere();
    let mut lighting = Lighting {
        environment_from_world: Mat3::IDENTITY.to_cols_array_2d().map(padded),
        center: center.to_array(),
        radius,
        half_extent: (0.5 * (geometry.bounds[1] - geometry.bounds[0])).to_array(),
        environment_bands: 1,
        environment_columns: 1,
        ..Default::default()
    };
    if let Some(environment) = &scene.environment {
        lighting.environment = environment.radiance.to_array();
        lighting.environment_rows_at_poles =
            u32::from(environment.map.as_ref().is_some_and(|m| m.rows == Rows::AtPoles));
        lighting.environment_from_world = environment.world_from_environment.transpose().to_cols_array_2d().map(padded);
    }
    if let Some(sky) = sky {
        lighting.environment_integral = sky.integral;
        lighting.environment_bands = sky.bands;
        lighting.environment_columns = sky.columns;
    }
    lighting
}

impl SkyTable {
    /// Tabulates a map. None if the map is black.
    fn new(map: &EnvironmentMap) -> Option<Self> {
        let (width, height) = (map.width as usize, map.height as usize);
        let luminance = |row: usize, column: usize| {
            let texel = map.texels[row.min(height - 1) * width + column % width];
            f64::from(Vec3::from(texel).dot(LUMINANCE).max(0.0))
        };
        // Band boundaries are the rows of texels, and the poles.
        let bands = if map.rows == Rows::AtPoles { (height - 1).max(1) } else { height + 1 };
        let knot = |band: usize| match map.rows {
            Rows::AtPoles => band as f64 / (height - 1).max(1) as f64,
            Rows::Centred => ((band as f64 - 0.5) / height as f64).clamp(0.0, 1.0),
        };
        let above = |band: usize| if map.rows == Rows::AtPoles { band } else { band.saturating_sub(1) };
        let below = |band: usize| if map.rows == Rows::AtPoles { band + 1 } else { band };
        let mut columns = Vec::with_capacity(bands * width);
        let mut sums = Vec::with_capacity(bands);
        let mut integral = 0.0;
        for band in 0..bands {
            let mut sum = 0.0;
            let cells: Vec<f64> = (0..width)
                .map(|cell| {
                    let (a, b) = (above(band), below(band));
                    sum += luminance(a, cell) + luminance(a, cell + 1) + luminance(b, cell) + luminance(b, cell + 1);
                    sum
                })
                .collect();
            columns.extend(cells.iter().map(|c| if sum > 0.0 { (c / sum) as f32 } else { 0.0 }));
            let sine = (0.5 * (knot(band) + knot(band + 1)) * std::f64::consts::PI).sin();
            integral += 0.25 * sum / width as f64 * (knot(band + 1) - knot(band)) * sine;
            sums.push(integral);
        }
        let shares: Vec<f32> = sums.iter().map(|s| (s / integral) as f32).chain(columns).collect();
        let integral = integral as f32;
        (integral > 0.0 && integral.is_finite()).then_some(Self {
            shares,
            bands: bands as u32,
            columns: width as u32,
            integral,
        })
    }
}

impl LightRecord {
    /// True if all light subpaths leave the light from the same point or in the same direction.
    #[must_use]
    pub fn is_fixed(&self) -> bool {
        self.kind < AREA && self.radius <= 0.0
    }

    /// True if the light is infinitely far away.
    #[must_use]
    pub fn is_infinite(&self) -> bool {
        matches!(self.kind, DIRECTIONAL | SKY)
    }
}

/// Returns the power of a light in watts, per channel; for a directional light the flux through a disc of
/// area `disc`.
fn power(light: &Light, patterns: &[Pattern], disc: f32) -> Vec3 {
    match *light {
        Light::Point { intensity, .. } => 4.0 * PI * intensity,
        Light::Spot { intensity, outer_angle, .. } => 2.0 * PI * versine(outer_angle) * intensity,
        Light::Directional { irradiance, .. } | Light::Sun { irradiance, .. } => disc * irradiance,
        Light::Lamp(lamp) => lamp.power(patterns),
    }
}

/// Returns the record of a punctual light.
fn record(light: &Light, patterns: &[Pattern], first_entries: &[u32]) -> LightRecord {
    let record = LightRecord { triangle: u32::MAX, ..Default::default() };
    match *light {
        Light::Point { position, intensity } => {
            LightRecord { position: position.to_array(), intensity: intensity.to_array(), ..record }
        }
        Light::Spot { position, direction, intensity, inner_angle, outer_angle, falloff } => LightRecord {
            kind: SPOT,
            position: position.to_array(),
            direction: direction.to_array(),
            intensity: intensity.to_array(),
            inner_versine: versine(inner_angle.min(outer_angle)),
            outer_versine: versine(outer_angle),
            falloff: u32::from(falloff == SpotFalloff::AngleLinear),
            ..record
        },
        Light::Directional { direction, irradiance } => LightRecord {
            kind: DIRECTIONAL,
            direction: direction.to_array(),
            intensity: irradiance.to_array(),
            ..record
        },
        Light::Sun { direction, irradiance, angle, .. } => LightRecord {
            kind: DIRECTIONAL,
            direction: direction.to_array(),
            intensity: (irradiance * (2.0 / (1.0 + angle.cos()))).to_array(),
            radius: versine(angle),
            ..record
        },
        Light::Lamp(lamp) => {
            let Lamp { position, world_from_lamp, radius, intensity, cone, pattern } = lamp;
            let outer = cone.map_or_else(|| lamp.outer_angle(patterns), |c| c.outer_angle);
            // Without a cone, the pattern's extent is a cone with a hard edge. A cone of nearly all
            // directions is a point light.
            let inner = cone.map_or(outer, |c| c.inner_angle).min(outer);
            let linear = cone.is_none_or(|c| c.falloff == SpotFalloff::AngleLinear);
            LightRecord {
                kind: if cone.is_none() && outer > 0.9 * PI { POINT } else { SPOT },
                position: position.to_array(),
                direction: lamp.direction().to_array(),
                intensity: intensity.to_array(),
                triangle: pattern.map_or(u32::MAX, |p| first_entries[p]),
                inner_versine: versine(inner),
                outer_versine: versine(outer),
                falloff: u32::from(linear),
                right: world_from_lamp.x_axis.to_array(),
                radius,
                ..record
            }
        }
    }
}

/// Concatenates the patterns, and returns the index of each pattern's first entry.
fn flatten(patterns: &[Pattern]) -> (Vec<[f32; 4]>, Vec<u32>) {
    let (mut entries, mut first) = (Vec::new(), Vec::new());
    for pattern in patterns {
        first.push(entries.len() as u32);
        let (mapping, half) = match pattern.mapping {
            Mapping::Sphere => (0.0, Vec2::ZERO),
            Mapping::Image { half_extent } => (1.0, half_extent),
            Mapping::Projection { half_extent } => (2.0, half_extent),
        };
        entries.push([pattern.width as f32, pattern.height as f32, mapping, 0.0]);
        entries.push([half.x, half.y, 0.0, 0.0]);
        entries.extend(pattern.texels.iter().copied().map(padded));
    }
    (entries, first)
}

/// Returns the Morton code of a position in the scene's bounding box: the interleaved bits of its
/// coordinates.
fn morton_code(position: Vec3, geometry: &Geometry) -> u32 {
    let [low, high] = geometry.bounds;
    let inside = ((position - low) / (high - low).max(Vec3::splat(f32::MIN_POSITIVE))).clamp(Vec3::ZERO, Vec3::ONE);
    let cells = (inside * 1023.0).as_uvec3();
    let spaced = |v: u32| (0..10).map(|bit| (v >> bit & 1) << (3 * bit)).sum::<u32>();
    spaced(cells.x) | spaced(cells.y) << 1 | spaced(cells.z) << 2
}

/// Pads a column to four components, as shaders store columns of matrices.
fn padded([x, y, z]: [f32; 3]) -> [f32; 4] {
    [x, y, z, 0.0]
}
