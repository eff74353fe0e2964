//! Random numbers of tests, the same in every run.

use glam::{Vec2, Vec3};

/// SplitMix64.
pub struct Random(pub u64);

impl Random {
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let x = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        x ^ (x >> 31)
    }

    pub fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1 << 24) as f32
    }

    pub fn pair(&mut self) -> [f32; 2] {
        [self.unit(), self.unit()]
    }

    pub fn between(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }

    pub fn below(&mut self, n: u64) -> usize {
        (self.bits() % n) as usize
    }

    pub fn color(&mut self) -> Vec3 {
        Vec3::new(self.unit(), self.unit(), self.unit())
    }

    pub fn direction(&mut self) -> Vec3 {
        loop {
            let v = self.color() * 2.0 - 1.0;
            if (0.01..1.0).contains(&v.length_squared()) {
                return v.normalize();
            }
        }
    }

    pub fn uv(&mut self) -> Vec2 {
        Vec2::new(self.between(-3.0, 3.0), self.between(-3.0, 3.0))
    }
}
