//! Crop windows: parts of an image that are rendered and written by themselves.

use std::fmt;
use std::str::FromStr;

/// A rectangle of pixels of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Crop {
    /// Its left column, from 0.
    pub x: u32,
    /// Its upper row, from 0.
    pub y: u32,
    /// Its columns, at least 1.
    pub width: u32,
    /// Its rows, at least 1.
    pub height: u32,
}

impl Crop {
    /// Returns the crop of a whole image.
    #[must_use]
    pub fn whole(width: u32, height: u32) -> Self {
        Self { x: 0, y: 0, width, height }
    }

    /// True if the crop has a pixel and lies in an image.
    #[must_use]
    pub fn fits(&self, width: u32, height: u32) -> bool {
        let within =
            |first: u32, count: u32, side: u32| count > 0 && first.checked_add(count).is_some_and(|n| n <= side);
        within(self.x, self.width, width) && within(self.y, self.height, height)
    }

    /// Returns the index of each pixel of the crop in an image of `width` columns, row by row.
    pub fn pixels(self, width: u32) -> impl Iterator<Item = u32> {
        (self.y..self.y + self.height).flat_map(move |y| (self.x..self.x + self.width).map(move |x| y * width + x))
    }

    /// True if the crop has a pixel of the square of `side` pixels in a row and column of squares.
    #[must_use]
    pub fn touches(&self, [column, row]: [u32; 2], side: u32) -> bool {
        let overlap =
            |first: u32, count: u32, square: u32| first < (square + 1) * side && square * side < first + count;
        overlap(self.x, self.width, column) && overlap(self.y, self.height, row)
    }
}

impl fmt::Display for Crop {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{},{},{},{}", self.x, self.y, self.width, self.height)
    }
}

impl FromStr for Crop {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let numbers: Option<Vec<u32>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
        match numbers.as_deref() {
            Some(&[x, y, width, height]) => Ok(Self { x, y, width, height }),
            _ => Err("a crop is X,Y,W,H in pixels from the upper left corner, such as 320,180,64,64"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_crop_is_a_rectangle_of_the_image() {
        let crop: Crop = "1, 2,3,1".parse().unwrap();
        assert_eq!((crop, crop.to_string()), (Crop { x: 1, y: 2, width: 3, height: 1 }, "1,2,3,1".to_owned()));
        assert!(crop.fits(4, 3) && !crop.fits(3, 3) && !crop.fits(4, 2) && Crop::whole(4, 3).fits(4, 3));
        for bad in ["0,0,0,1", "0,0,1,0", "4,0,1,1", "4294967295,0,2,1"] {
            assert!(!bad.parse::<Crop>().unwrap().fits(4, 3), "{bad}");
        }
        for bad in ["", "1,2,3", "1,2,3,4,5", "-1,2,3,4", "1.5,2,3,4", "a,b,c,d"] {
            assert!(bad.parse::<Crop>().is_err(), "{bad}");
        }
    }

    #[test]
    fn squares_that_a_crop_touches() {
        let crop = Crop { x: 15, y: 16, width: 2, height: 16 };
        let touched = |row| [0, 1, 2].map(|column| crop.touches([column, row], 16));
        assert_eq!([touched(0), touched(1), touched(2)], [[false; 3], [true, true, false], [false; 3]]);
    }
}
