//! Scenes far from the origin, as surveyors and maps place them: 32 bits hold a coordinate of five million metres to half a
//! metre, so that such scenes are moved to the origin before they are rounded.

use glam::DVec3;

/// Distance from the origin over the extent of what is there from which on it is moved: positions then have less than four
/// digits of it.
const FAR: f64 = 1000.0;

/// Least extent, in metres.
const LEAST_EXTENT: f64 = 10.0;

/// Returns by how much to move points towards the origin, in whole metres; zero if they are not far from it.
pub(super) fn origin(points: impl IntoIterator<Item = DVec3>) -> DVec3 {
    let empty = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (least, most) = points.into_iter().fold(empty, |(least, most), p| (least.min(p), most.max(p)));
    let middle = 0.5 * (least + most);
    let is_far = middle.length() > FAR * (most - least).length().max(LEAST_EXTENT);
    if is_far && middle.is_finite() { middle.round() } else { DVec3::ZERO }
}

/// Returns what to say of a scene that is moved; nothing if it is not.
pub(super) fn said(origin: DVec3) -> Option<String> {
    (origin != DVec3::ZERO)
        .then(|| format!("the scene is far from the origin: it is moved by {}, so that no digits are lost", -origin))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_far_for_its_extent_is_moved() {
        let at = |distance: f64, extent: f64| origin([DVec3::X * distance, DVec3::new(distance, extent, 0.0)]);
        assert_eq!(at(500_000.3, 40.0), DVec3::new(500_000.0, 20.0, 0.0));
        assert_eq!(at(500_000.3, 4000.0), DVec3::ZERO);
        assert_eq!(at(5000.0, 1e-3), DVec3::ZERO);
        for points in [vec![], vec![DVec3::NAN], vec![DVec3::INFINITY], vec![DVec3::splat(1e300), DVec3::splat(-1e300)]]
        {
            assert_eq!(origin(points.clone()), DVec3::ZERO, "{points:?}");
        }
        assert_eq!(said(DVec3::ZERO), None);
        assert!(said(DVec3::X * 5e5).unwrap().contains("[-500000"));
    }
}
