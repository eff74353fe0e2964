//! Chooses a camera automatically: objects in a three-quarter view from a little above, without the ground that
//! they stand on, flat objects from their front, rooms from inside.
//!
//! The choice is made by ray casting on the CPU. Sample points on the surfaces measure the fraction of the
//! scene that a view shows, and decide if most of it is visible from outside at all. Rays from points at eye
//! height measure if these are enclosed, and the visible distance.

use std::f32::consts::{PI, TAU};
use std::ops::Range;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::reference::Reference;
use crate::reference::bvh::Hit;
use crate::scene::{Camera, FovAxis, Geometry, Projection, Sides};

use super::ground;

/// Full angle of view along the shorter side, radians: a short telephoto lens for objects, a wide-angle lens
/// for rooms.
const OBJECT_FOV: f32 = 35.0 * PI / 180.0;
const ROOM_FOV: f32 = 65.0 * PI / 180.0;

/// Fraction of the frame's width or height that an object spans.
const FILL: f32 = 0.84;

/// Number of sample points on the surfaces.
const SAMPLES: usize = 1024;

/// Largest ratio of thickness to width and height of a flat object. Horizontal ones, such as a floor with
/// something on it, have to be flatter to be viewed from above.
const FLAT: f32 = 0.25;
const LYING_FLAT: f32 = 0.02;

/// Fraction of the surfaces that forms the main part of a scene, and the largest distance from its centre,
/// relative to the main part's radius, of points that are framed.
const NEARLY_ALL: f32 = 0.98;
const FAR: f32 = 1.6;

/// Numbers of points at eye height along each horizontal side, and of heights at which floors are searched.
const PLACES: usize = 9;
const LEVELS: usize = 4;

/// Number of directions in which the surroundings of a point are sampled.
const DIRECTIONS: usize = 96;

/// Sine of the elevation above which the surroundings of a point without a ceiling may be open.
const OPEN_ABOVE: f32 = 0.35;

/// Heights of rooms of a natural size, and of the eye above their floors, metres.
const NATURAL_HEIGHTS: Range<f32> = 2.0..20.0;
const EYE_HEIGHT: f32 = 1.6;

/// Height of other spaces over that of the scene from which on they may be rooms: the cells of a solid that is meshed inside are
/// none.
const LEAST_HEIGHT: f32 = 0.1;

/// Least fraction of the directions around a point that hit surfaces, in a closed room and in a scene that is
/// open on one side. Of the points of the second kind in a room, half have to be of the first.
const SHARE_CLOSED: f32 = 0.5;
const CLOSED: f32 = 0.92;
const PARTLY_CLOSED: f32 = 0.6;

/// Least fraction of all points at eye height that are at least partly enclosed, for a room and for a stage.
const PLACES_OF_A_ROOM: f32 = 0.02;
const PLACES_OF_A_STAGE: f32 = 0.08;

/// Largest fraction of the surfaces that is visible from outside, for a room (twice as much if all points are
/// closed) and for a stage.
const SEEN_FROM_OUTSIDE: f32 = 0.2;
const SEEN_OF_A_STAGE: f32 = 0.55;

/// Least product of the shares of a stage's enclosed places and of the surfaces that are seen from where it is viewed: 0.4
/// or more in open boxes, 0.03 or less in houses with openings, which are viewed from inside.
const SHOWN_OF_A_STAGE: f32 = 0.1;

/// Largest share of the surfaces that is seen from outside a house, or least share of the points at eye height that are in
/// it: 0.07 or less and 0.3 or more in houses with openings, 0.11 or more and 0.2 or less in hollow objects and cars.
const SHOWN_OF_A_HOUSE: f32 = 0.09;
const PLACES_OF_A_HOUSE: f32 = 0.25;

/// [`SEEN_FROM_OUTSIDE`] and [`PLACES_OF_A_HOUSE`] where spaces are not of a natural height: 0.15 or more of the surfaces are
/// visible from outside hollow objects, which enclose 0.33 or less of the points.
const SEEN_OF_A_MODEL: f32 = 0.05;
const PLACES_OF_A_MODEL: f32 = 0.5;

/// Share of an object's length below which a view counts less, such as one along a tube.
const SHORTENED: f32 = 0.5;

/// Largest ratio of height to width of a horizontal scene.
const LYING: f32 = 0.25;

/// Number of view directions that are tried at each point in a room.
const YAWS: usize = 16;

/// Name of an automatically chosen camera.
pub const AUTO: &str = "auto";

/// Kind of subject of an automatically chosen camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Subject {
    /// The scene is empty.
    Empty,
    /// An object, seen from outside.
    Object,
    /// A flat object, seen from its front.
    Flat,
    /// A scene that is open on one side, seen from there.
    Stage,
    /// A room, seen from inside.
    Room,
}

/// A sample point on a surface.
struct Sample {
    position: Vec3,
    /// Unit normal of the front side.
    normal: Vec3,
    triangle: u32,
    two_sided: bool,
}

/// A point at eye height that is at least partly enclosed.
struct Place {
    eye: Vec3,
    closed: f32,
    /// The space is as high as rooms are.
    natural: bool,
}

/// Chooses a camera for an image size in pixels. It frames the reference's own pose, and `posed`: [`subject_points`] of
/// others.
#[must_use]
pub fn choose(reference: &Reference, posed: &[Vec3], size: [u32; 2]) -> (Camera, Subject) {
    let mut samples = samples(reference, |_| true);
    if samples.is_empty() {
        let eye = Vec3::new(1.0, 1.0, 3.0);
        return (camera(OBJECT_FOV, eye, Vec3::ZERO), Subject::Empty);
    }
    let geometry = reference.geometry();
    let ground = ground::find(geometry);
    let points: Vec<Vec3> = without(geometry, &ground).chain(posed.iter().copied()).collect();
    let [x, y, z] = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| extent(&points, axis));
    let lies = y < LYING * x.min(z);
    let enclosure = enclosure(reference, &samples);
    if let Enclosure::Room(places) = &enclosure
        && let Some(camera) = inside(reference, &samples, places, size)
    {
        return (camera, Subject::Room);
    }
    if ground.contains(&true) {
        samples = self::samples(reference, |corners| !ground[corners[0] as usize]);
    }
    let points = &main_part(&samples, &points);
    let length = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| extent(points, axis)).into_iter().fold(0.0, f32::max);
    let best_of = |views: Vec<(Vec3, f32)>| {
        let judged = views.into_par_iter().map(|(towards_eye, weight)| {
            let camera = fit(points, towards_eye, size);
            let [right, up] = [camera.world_from_camera.x_axis, camera.world_from_camera.y_axis].map(Vec3::from);
            let of_length = extent(points, right).max(extent(points, up)) / (SHORTENED * length).max(f32::MIN_POSITIVE);
            let shown = shown(reference, &samples, Vec3::from(camera.world_from_camera.translation));
            (weight * of_length.min(1.0) * shown, camera)
        });
        best(judged.collect()).unwrap_or_else(|| fit(points, Vec3::Z, size))
    };
    // The streets of a town are partly enclosed, but a town is not viewed like a stage.
    if let Enclosure::Stage(places) = &enclosure
        && !lies
    {
        let camera = best_of(directions(&STAGE_VIEWS));
        let eye = Vec3::from(camera.world_from_camera.translation);
        let (of_places, of_surfaces) = (places_shown(reference, places, eye), shown(reference, &samples, eye));
        log::debug!("camera: from outside {of_places} of these places and {of_surfaces} of the surfaces are seen");
        if of_places * of_surfaces >= SHOWN_OF_A_STAGE {
            return (camera, Subject::Stage);
        }
        let closed = eyes(places, CLOSED);
        let eyes = if closed.is_empty() { eyes(places, PARTLY_CLOSED) } else { closed };
        let least = if are_natural(places) { PLACES_OF_A_HOUSE } else { PLACES_OF_A_MODEL };
        let is_house = of_surfaces < SHOWN_OF_A_HOUSE || share_of_places(places) >= least;
        if is_house && let Some(camera) = inside(reference, &samples, &eyes, size) {
            return (camera, Subject::Room);
        }
    }
    let (views, subject) = match flat_front(reference, &samples, points) {
        Some(front) => (vec![(front, 1.0)], Subject::Flat),
        None if lies => (directions(&LYING_VIEWS), Subject::Object),
        None => (directions(&VIEWS), Subject::Object),
    };
    (best_of(views), subject)
}

/// Returns the positions of the vertices that a picture is about: all but those of a ground.
#[must_use]
pub fn subject_points(geometry: &Geometry) -> Vec<Vec3> {
    without(geometry, &ground::find(geometry)).collect()
}

/// Returns the positions of the vertices that do not belong to a ground.
fn without(geometry: &Geometry, ground: &[bool]) -> impl Iterator<Item = Vec3> {
    geometry.vertices.iter().zip(ground).filter(|(_, ground)| !**ground).map(|(v, _)| v.position)
}

/// Azimuth and elevation of views from outside, degrees, and a preference by which the visible fraction is
/// multiplied.
const VIEWS: [(f32, f32, f32); 9] = [
    (30.0, 20.0, 1.0),
    (-30.0, 20.0, 0.95),
    (30.0, 40.0, 0.75),
    (0.0, 8.0, 0.8),
    (120.0, 20.0, 0.7),
    (-120.0, 20.0, 0.7),
    (90.0, 8.0, 0.65),
    (-90.0, 8.0, 0.65),
    (180.0, 8.0, 0.65),
];

/// The same for horizontal scenes, such as a town. They are viewed from above, since otherwise little of the
/// image would be filled.
const LYING_VIEWS: [(f32, f32, f32); 4] =
    [(15.0, 45.0, 1.0), (-15.0, 45.0, 0.95), (105.0, 45.0, 0.7), (195.0, 45.0, 0.65)];

/// The same for scenes that are open on one side.
const STAGE_VIEWS: [(f32, f32, f32); 4] = [(0.0, 0.0, 1.0), (90.0, 0.0, 0.9), (-90.0, 0.0, 0.9), (180.0, 0.0, 0.85)];

fn directions(views: &[(f32, f32, f32)]) -> Vec<(Vec3, f32)> {
    views.iter().map(|&(azimuth, elevation, weight)| (direction(azimuth, elevation), weight)).collect()
}

/// Returns the extent of points along a unit vector, metres.
fn extent(points: &[Vec3], axis: Vec3) -> f32 {
    let along = points.iter().map(|p| p.dot(axis));
    let (low, high) = along.fold((f32::MAX, f32::MIN), |(low, high), x| (low.min(x), high.max(x)));
    high - low
}

/// Returns the unit vector at an azimuth from +Z towards +X and an elevation, degrees.
pub(super) fn direction(azimuth: f32, elevation: f32) -> Vec3 {
    let (azimuth, elevation) = (azimuth.to_radians(), elevation.to_radians());
    Vec3::new(azimuth.sin() * elevation.cos(), elevation.sin(), azimuth.cos() * elevation.cos())
}

/// Returns a pinhole camera at `eye` that looks at `target`.
fn camera(fov: f32, eye: Vec3, target: Vec3) -> Camera {
    let camera = Camera {
        name: AUTO.to_owned(),
        world_from_camera: glam::Affine3A::from_translation(eye),
        projection: Projection::Perspective { fov, axis: FovAxis::Smaller },
        lens: None,
        film_size: None,
    };
    camera.clone().looking(eye, target).unwrap_or(camera)
}

/// Returns the camera in a direction from the points at the distance at which they span [`FILL`] of the
/// frame.
fn fit(points: &[Vec3], towards_eye: Vec3, [width, height]: [u32; 2]) -> Camera {
    let axes = camera(OBJECT_FOV, towards_eye, Vec3::ZERO);
    let slopes = axes.half_extent(width, height) * FILL;
    let world = axes.world_from_camera;
    let [right, up, back] = [world.x_axis, world.y_axis, world.z_axis].map(|axis| Vec3::from(axis).as_dvec3());
    let slopes = slopes.as_dvec2();
    // Each point restricts the eye by two planes on the left and right, and two above and below.
    let (mut low, mut high) = (glam::DVec2::NEG_INFINITY, glam::DVec2::INFINITY);
    let mut nearest = f64::INFINITY;
    for point in points {
        let point = point.as_dvec3();
        let (place, depth) = (glam::DVec2::new(point.dot(right), point.dot(up)), -point.dot(back));
        low = low.max(place - slopes * depth);
        high = high.min(place + slopes * depth);
        nearest = nearest.min(depth);
    }
    let depth = ((high - low) / (2.0 * slopes)).min_element();
    // A single point has no extent, and any distance is valid.
    let depth = if depth < nearest { depth } else { nearest - 1.0 };
    let middle = 0.5 * (low + high);
    let eye = right * middle.x + up * middle.y - back * depth;
    let distance = (nearest - depth).max(f64::from(f32::MIN_POSITIVE));
    camera(OBJECT_FOV, eye.as_vec3(), (eye - back * distance).as_vec3())
}

/// Samples points on the triangles whose corners are asked for: half of them by area, half of them uniformly over
/// triangles, since small parts often are the subject of a picture.
fn samples(reference: &Reference, asked_for: impl Fn(&[u32; 3]) -> bool) -> Vec<Sample> {
    let geometry = reference.geometry();
    let from: Vec<usize> = (0..geometry.triangles.len()).filter(|&i| asked_for(&geometry.triangles[i])).collect();
    let count = from.len();
    let area = |i: usize| {
        let [a, b, c] = geometry.positions(i);
        f64::from((b - a).cross(c - a).length())
    };
    let total: f64 = from.iter().map(|&i| area(i)).sum();
    if count == 0 || total <= 0.0 {
        return Vec::new();
    }
    let half = SAMPLES / 2;
    let mut triangles: Vec<usize> = (0..half).map(|n| from[n * count / half]).collect();
    let mut sum = 0.0;
    for i in from {
        sum += area(i);
        while triangles.len() < 2 * half && sum >= total * ((triangles.len() - half) as f64 + 0.5) / half as f64 {
            triangles.push(i);
        }
    }
    let sample = |(n, i): (usize, usize)| {
        // The R2 sequence (M. Roberts 2018), folded into the triangle.
        let at = Vec2::new(0.754_877_7, 0.569_840_3) * n as f32;
        let [mut u, mut v] = at.fract().to_array();
        if u + v > 1.0 {
            (u, v) = (1.0 - u, 1.0 - v);
        }
        let [a, b, c] = geometry.positions(i);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let two_sided = reference.material(i as u32).sides == Sides::Two;
        Sample { position: a + (b - a) * u + (c - a) * v, normal, triangle: i as u32, two_sided }
    };
    triangles.into_iter().enumerate().map(sample).collect()
}

/// Returns the fraction of the points that is visible from a position.
fn shown(reference: &Reference, samples: &[Sample], eye: Vec3) -> f32 {
    samples.iter().filter(|sample| is_seen(reference, sample, eye)).count() as f32 / samples.len() as f32
}

/// Returns true if a point is visible from a position.
fn is_seen(reference: &Reference, sample: &Sample, eye: Vec3) -> bool {
    let to = sample.position - eye;
    let distance = to.length();
    let reaches = |hit: Hit| hit.triangle == sample.triangle || hit.t > 0.999 * distance;
    (sample.two_sided || sample.normal.dot(to) < 0.0) && reference.first_hit(eye, to / distance).is_some_and(reaches)
}

/// Returns the fraction of the points that is visible in a camera's image.
fn shown_in_frame(reference: &Reference, samples: &[Sample], camera: &Camera, [width, height]: [u32; 2]) -> f32 {
    let eye = Vec3::from(camera.world_from_camera.translation);
    let in_frame: Vec<&Sample> =
        samples.iter().step_by(4).filter(|s| camera.project(s.position, width, height).is_some()).collect();
    let seen = in_frame.into_iter().filter(|sample| is_seen(reference, sample, eye)).count();
    (4 * seen) as f32 / samples.len() as f32
}

/// Returns the points except those that are far from nearly all of the surfaces, such as forgotten objects.
fn main_part(samples: &[Sample], points: &[Vec3]) -> Vec<Vec3> {
    let median = |mut values: Vec<f32>, share: f32| {
        let n = ((values.len() - 1) as f32 * share) as usize;
        *values.select_nth_unstable_by(n, f32::total_cmp).1
    };
    let middle = Vec3::from([0, 1, 2].map(|axis| median(samples.iter().map(|s| s.position[axis]).collect(), 0.5)));
    let reach = median(samples.iter().map(|s| s.position.distance(middle)).collect(), NEARLY_ALL);
    points.iter().copied().filter(|p| p.distance(middle) <= FAR * reach).collect()
}

/// Returns the direction that most of a flat object faces; none if the scene is not flat.
fn flat_front(reference: &Reference, samples: &[Sample], points: &[Vec3]) -> Option<Vec3> {
    // The second half of the samples is distributed by area.
    let by_area = samples[samples.len() / 2..].iter().map(|s| s.normal);
    let mean = by_area.reduce(|a, b| if b.dot(a) < 0.0 { a - b } else { a + b })?.try_normalize()?;
    let thickness = |axis: Vec3| {
        let world = camera(OBJECT_FOV, axis, Vec3::ZERO).world_from_camera;
        let [across, along] = [world.x_axis, world.y_axis].map(|side| extent(points, side.into()));
        extent(points, axis) / across.min(along)
    };
    let axes = [mean, Vec3::Z, Vec3::X, Vec3::Y].map(|axis| (thickness(axis), axis));
    let (thickness, axis) = axes.into_iter().reduce(|a, b| if b.0 < a.0 { b } else { a })?;
    let flat = if axis.y.abs() > 0.7 { LYING_FLAT } else { FLAT };
    if thickness.is_nan() || thickness > flat {
        return None;
    }
    let far = 10.0 * [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| extent(points, axis)).into_iter().fold(0.0, f32::max);
    let middle = points.iter().sum::<Vec3>() / points.len() as f32;
    let shown = [axis, -axis].map(|side| shown(reference, samples, middle + side * far));
    // If both sides show equally much, the camera is placed at the front, or above.
    let alike = (shown[0] - shown[1]).abs() <= 0.1 * (shown[0] + shown[1]);
    let first = if alike { axis.dot(Vec3::new(0.1, 0.5, 1.0)) > 0.0 } else { shown[0] > shown[1] };
    Some(if first { axis } else { -axis })
}

/// Returns uniformly distributed directions (spherical Fibonacci lattice).
pub(super) fn sphere(count: usize) -> impl Iterator<Item = Vec3> {
    (0..count).map(move |n| {
        let y = 1.0 - (2.0 * n as f32 + 1.0) / count as f32;
        let phi = TAU * (n as f32 * 0.618_034).fract();
        let radius = (1.0 - y * y).sqrt();
        Vec3::new(radius * phi.cos(), y, radius * phi.sin())
    })
}

/// Returns the visibility of the surfaces from outside: the fraction of horizontal and upward directions from
/// the sample points that leave the scene.
fn seen_from_outside(reference: &Reference, samples: &[Sample]) -> f32 {
    let directions: Vec<Vec3> = sphere(48).filter(|d| (-0.1..0.75).contains(&d.y)).collect();
    let open = |sample: &Sample| {
        let facing: Vec<_> = directions.iter().filter(|d| sample.normal.dot(**d) > 0.05).collect();
        let sees = |direction: Vec3| reference.closest_hit(sample.position, direction, Some(sample.triangle)).is_some();
        let free = facing.iter().filter(|d| !sees(***d)).count();
        free as f32 / facing.len().max(1) as f32
    };
    let sum: f32 = samples.par_iter().step_by(2).map(open).collect::<Vec<_>>().iter().sum();
    sum / (samples.len() / 2) as f32
}

/// The kind of space that a scene encloses.
enum Enclosure {
    /// The scene encloses no space.
    None,
    /// A space that is open on one side, such as a stage, with its partly enclosed places.
    Stage(Vec<Place>),
    /// A room, with positions for the eye.
    Room(Vec<Vec3>),
}

/// Returns the positions of places that are closed at least so much.
fn eyes(places: &[Place], closed: f32) -> Vec<Vec3> {
    places.iter().filter(|place| place.closed >= closed).map(|place| place.eye).collect()
}

/// Returns the fraction of all points at eye height that these are.
fn share_of_places(places: &[Place]) -> f32 {
    places.len() as f32 / (PLACES * PLACES * LEVELS) as f32
}

/// Returns true if at least half of the places are in spaces of a natural height.
fn are_natural(places: &[Place]) -> bool {
    2 * places.iter().filter(|place| place.natural).count() >= places.len()
}

fn enclosure(reference: &Reference, samples: &[Sample]) -> Enclosure {
    let places = places(reference);
    let enclosed = share_of_places(&places);
    if enclosed < PLACES_OF_A_ROOM {
        return Enclosure::None;
    }
    let rooms = eyes(&places, CLOSED);
    let share = rooms.len() as f32 / places.len() as f32;
    let outside = seen_from_outside(reference, samples);
    log::debug!(
        "camera: {enclosed} of the places are enclosed, {share} of these closed; {outside} is seen from outside"
    );
    let seen_of_a_room = if are_natural(&places) { SEEN_FROM_OUTSIDE * (1.0 + share) } else { SEEN_OF_A_MODEL };
    if share >= SHARE_CLOSED && outside <= seen_of_a_room {
        Enclosure::Room(rooms)
    } else if enclosed >= PLACES_OF_A_STAGE && outside <= SEEN_OF_A_STAGE {
        Enclosure::Stage(places)
    } else {
        Enclosure::None
    }
}

/// Returns the fraction of places that is visible from a position.
fn places_shown(reference: &Reference, places: &[Place], eye: Vec3) -> f32 {
    let is_seen = |place: &&Place| {
        let to = place.eye - eye;
        reference.first_hit(eye, to.normalize_or(Vec3::NEG_Z)).is_none_or(|hit| hit.t > to.length())
    };
    places.iter().filter(is_seen).count() as f32 / places.len() as f32
}

/// Returns the camera in a room with the best product of visible distance and visible fraction of the
/// surfaces.
fn inside(reference: &Reference, samples: &[Sample], places: &[Vec3], size: [u32; 2]) -> Option<Camera> {
    let views = places
        .par_iter()
        .flat_map_iter(|&eye| (0..YAWS).map(move |n| (eye, direction(360.0 * n as f32 / YAWS as f32, 0.0))));
    let judged = views.map(|(eye, forward)| {
        let camera = camera(ROOM_FOV, eye, eye + forward * reference.geometry().sphere().1);
        (free_view(reference, &camera, size) * shown_in_frame(reference, samples, &camera, size), camera)
    });
    best(judged.collect())
}

/// Returns the first camera with the highest score.
fn best(judged: Vec<(f32, Camera)>) -> Option<Camera> {
    judged.into_iter().reduce(|a, b| if b.0 > a.0 { b } else { a }).map(|(_, camera)| camera)
}

/// Scores the visible distance of a camera by the mean square root of its rays' lengths, 0 for rays without a
/// hit. The square root limits the weight of a single long ray.
fn free_view(reference: &Reference, camera: &Camera, size: [u32; 2]) -> f32 {
    let (sum, count) = rays(camera, size, [12, 8]).fold((0.0, 0), |(sum, count), (eye, direction)| {
        (sum + reference.first_hit(eye, direction).map_or(0.0, |hit| hit.t.sqrt()), count + 1)
    });
    sum / count as f32
}

/// Returns origins and directions of a grid of a camera's rays.
pub(super) fn rays(
    camera: &Camera,
    [width, height]: [u32; 2],
    [columns, rows]: [u32; 2],
) -> impl Iterator<Item = (Vec3, Vec3)> {
    let half = camera.half_extent(width, height);
    let world = camera.world_from_camera;
    let parallel = matches!(camera.projection, Projection::Orthographic { .. });
    (0..columns * rows).map(move |n| {
        let at =
            Vec2::new((n % columns) as f32 + 0.5, (n / columns) as f32 + 0.5) / Vec2::new(columns as f32, rows as f32);
        let plane = (at * 2.0 - 1.0) * half;
        let (origin, direction) =
            if parallel { (plane.extend(0.0), Vec3::NEG_Z) } else { (Vec3::ZERO, plane.extend(-1.0)) };
        (world.transform_point3(origin), world.transform_vector3(direction).normalize())
    })
}

/// Returns the points at eye height that are partly enclosed and farther than a step from all surfaces.
fn places(reference: &Reference) -> Vec<Place> {
    let [low, high] = reference.geometry().bounds;
    let extent = high - low;
    if extent.min_element() <= 0.0 {
        return Vec::new();
    }
    let place = |n: usize| {
        let at = [n % PLACES, n / (PLACES * PLACES), n / PLACES % PLACES];
        let share = Vec3::from(at.map(|n| n as f32 + 0.5)) / Vec3::from([PLACES, LEVELS, PLACES].map(|n| n as f32));
        let start = low + extent * share;
        let floor = reference.closest_hit(start, Vec3::NEG_Y, None)?.t;
        let ceiling = reference.closest_hit(start, Vec3::Y, None).map_or(high.y - start.y, |hit| hit.t);
        let height = floor + ceiling;
        let natural = NATURAL_HEIGHTS.contains(&height);
        if !natural && height < LEAST_HEIGHT * extent.y {
            return None;
        }
        let (above, step) = if natural { (EYE_HEIGHT, 0.5) } else { (0.5 * height, 0.15 * height) };
        let eye = start + Vec3::Y * (above - floor);
        let around = surroundings(reference, eye);
        (around.closed >= PARTLY_CLOSED && around.free > step).then_some(Place { eye, closed: around.closed, natural })
    };
    (0..PLACES * PLACES * LEVELS).into_par_iter().filter_map(place).collect()
}

/// Surroundings of a point.
#[derive(Clone, Copy, Debug)]
struct Surroundings {
    /// Fraction of the directions that hit the front of a surface; without a ceiling, steep directions are
    /// not counted.
    closed: f32,
    /// Distance to the nearest surface that is not below, metres.
    free: f32,
}

fn surroundings(reference: &Reference, eye: Vec3) -> Surroundings {
    let roofed = reference.closest_hit(eye, Vec3::Y, None).is_some();
    let (mut closed, mut counted, mut free) = (0, 0, f32::INFINITY);
    for direction in sphere(DIRECTIONS).filter(|d| roofed || d.y < OPEN_ABOVE) {
        counted += 1;
        let Some(hit) = reference.closest_hit(eye, direction, None) else { continue };
        free = if direction.y > -0.5 { free.min(hit.t) } else { free };
        // From inside an object, rays hit back faces.
        closed += u32::from(reference.normal(hit.triangle).dot(direction) < 0.0);
    }
    Surroundings { closed: closed as f32 / counted.max(1) as f32, free }
}

/// A surface point that is visible to a camera.
pub(super) struct VisiblePoint {
    position: Vec3,
    /// Unit normal on the camera's side.
    normal: Vec3,
    triangle: u32,
}

impl VisiblePoint {
    /// Returns true if a ray in a direction on the camera's side of the surface leaves the scene.
    pub fn is_open(&self, reference: &Reference, direction: Vec3) -> bool {
        direction.dot(self.normal) > 0.0
            && reference.closest_hit(self.position, direction, Some(self.triangle)).is_none()
    }
}

/// Returns the surface points that are visible along `side` x `side` of a camera's rays.
pub(super) fn visible_points(reference: &Reference, camera: &Camera, side: u32) -> Vec<VisiblePoint> {
    rays(camera, [1, 1], [side, side])
        .filter_map(|(origin, direction)| {
            let hit = reference.first_hit(origin, direction)?;
            let front = reference.normal(hit.triangle);
            let normal = if front.dot(direction) < 0.0 { front } else { -front };
            // The point is moved slightly towards the camera, because of rounding and for thin walls.
            let position = origin + direction * (hit.t * (1.0 - 1e-5));
            Some(VisiblePoint { position, normal, triangle: hit.triangle })
        })
        .collect()
}

/// Returns true if a camera is in a room: nearly all directions around it are closed, except for steep ones
/// without a ceiling.
pub(super) fn is_inside(reference: &Reference, camera: &Camera) -> bool {
    let eye = Vec3::from(camera.world_from_camera.translation);
    surroundings(reference, eye).closed >= CLOSED
}
