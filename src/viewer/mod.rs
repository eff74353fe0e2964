//! The viewer: a window that shows a scene while it is rendered.
//!
//! Two threads that never wait for each other. The window's ([`window`]) owns winit, egui and a device that draws the interface;
//! it turns what the user does into an [`order::Order`] and shows the newest picture that there is. The [`studio`] owns a device
//! that renders; it works on the newest order. So input is handled within a frame of the interface, whatever a frame of the
//! picture costs, and either device may be lost without the other.
//!
//! Everything but the window is plain library code: [`stand`] moves the camera, [`knobs`] has every setting with its sentence,
//! [`crate::tonemap`] brings radiance to the screen, [`pace`] chooses how coarse a moving picture is, [`state`] is what the user has chosen and
//! writes the command line that renders the same, and [`ui`] turns it into egui's shapes.

pub mod engine;
pub mod knobs;
pub mod order;
pub mod pace;
pub mod screen;
pub mod stand;
pub mod state;
pub mod studio;
pub mod ui;
pub mod window;
