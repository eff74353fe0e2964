//! The record of a render: what made a picture, stored as attributes of its .exr, so that parts of a picture
//! can be merged and a picture can be made again.

use std::fmt;

/// A range of the samples of a sequence, counted from 1, both ends included.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
pub struct SampleRange {
    /// The first sample, at least 1.
    pub first: u64,
    /// The last sample, at least `first`.
    pub last: u64,
}

impl SampleRange {
    /// Returns the number of samples.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.last + 1 - self.first
    }

    /// Parses `A..B`, or one number for a range of one sample.
    ///
    /// # Errors
    /// Returns a sentence if the text is neither, or if B is less than A.
    pub fn parse(text: &str) -> Result<Self, String> {
        let (first, last) = text.split_once("..").unwrap_or((text, text));
        let range = first.parse().ok().zip(last.parse().ok()).map(|(first, last)| Self { first, last });
        range
            .filter(|range| 1 <= range.first && range.first <= range.last)
            .ok_or_else(|| "samples are two numbers from 1 on, the later one second, such as 257..512".to_owned())
    }
}

impl fmt::Display for SampleRange {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}..{}", self.first, self.last)
    }
}

/// What made a picture.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Record {
    /// The command line.
    pub command: String,
    /// The version of the program.
    pub version: String,
    /// The scene: a path or `builtin:NAME`.
    pub scene: String,
    /// SHA-256 of everything in the scene, as hexadecimal digits.
    pub scene_hash: String,
    /// The settings on which each sample depends, as JSON.
    pub settings: String,
    /// SHA-256 of `settings`, as hexadecimal digits.
    pub settings_hash: String,
    /// The samples per pixel.
    pub samples: u64,
    /// The seed of all random numbers.
    pub seed: u32,
    /// The parts of the sequence in the picture, in order and disjoint.
    pub ranges: Vec<SampleRange>,
    /// The device.
    pub device: String,
    /// Seconds of rendering, of all parts together.
    pub seconds: f64,
}

/// What all names of attributes begin with.
const PREFIX: &str = "lightsheaf:";

impl Record {
    /// Returns names and texts of the attributes.
    #[must_use]
    pub fn attributes(&self) -> Vec<(String, String)> {
        let ranges: Vec<String> = self.ranges.iter().map(SampleRange::to_string).collect();
        let named = [
            ("command", self.command.clone()),
            ("version", self.version.clone()),
            ("scene", self.scene.clone()),
            ("scene_hash", self.scene_hash.clone()),
            ("settings", self.settings.clone()),
            ("settings_hash", self.settings_hash.clone()),
            ("samples", self.samples.to_string()),
            ("seed", self.seed.to_string()),
            ("range", ranges.join(",")),
            ("device", self.device.clone()),
            ("seconds", self.seconds.to_string()),
        ];
        named.map(|(name, text)| (format!("{PREFIX}{name}"), text)).to_vec()
    }

    /// Returns the record that attributes hold; none if one is missing or cannot be read.
    #[must_use]
    pub fn from_attributes(attributes: &[(String, String)]) -> Option<Self> {
        let get = |wanted: &str| {
            let named = |name: &str| name.strip_prefix(PREFIX) == Some(wanted);
            attributes.iter().find(|(name, _)| named(name)).map(|(_, text)| text.clone())
        };
        let ranges = get("range")?;
        let ranges: Result<Vec<_>, _> = ranges.split(',').map(SampleRange::parse).collect();
        Some(Self {
            command: get("command")?,
            version: get("version")?,
            scene: get("scene")?,
            scene_hash: get("scene_hash")?,
            settings: get("settings")?,
            settings_hash: get("settings_hash")?,
            samples: get("samples")?.parse().ok()?,
            seed: get("seed")?.parse().ok()?,
            ranges: ranges.ok()?,
            device: get("device")?,
            seconds: get("seconds")?.parse().ok()?,
        })
    }

    /// True if an attribute belongs to a record.
    #[must_use]
    pub fn owns(name: &str) -> bool {
        name.starts_with(PREFIX)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn attributes_hold_a_record() {
        let ranges = vec![SampleRange { first: 1, last: 4 }, SampleRange { first: 9, last: 9 }];
        let record = Record { command: "a b".to_owned(), samples: 5, ranges, seconds: 0.125, ..Record::default() };
        let mut attributes = record.attributes();
        assert_eq!(Record::from_attributes(&attributes), Some(record));
        assert!(attributes.iter().all(|(name, _)| Record::owns(name)) && !Record::owns("comments"));
        attributes.pop();
        assert_eq!(Record::from_attributes(&attributes), None, "an attribute is missing");
    }

    #[test]
    fn ranges_are_parsed() {
        assert_eq!(SampleRange::parse("257..512"), Ok(SampleRange { first: 257, last: 512 }));
        assert_eq!(SampleRange::parse("7").map(|range| (range.count(), range.to_string())), Ok((1, "7..7".to_owned())));
        for bad in ["", "0..4", "4..3", "1..", "..2", "-1..2", "a..b", "1...3", "1.5"] {
            assert!(SampleRange::parse(bad).is_err(), "{bad}");
        }
    }
}
