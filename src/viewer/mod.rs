//! The viewer: a window that shows a scene while it is rendered.
//!
//! It has two threads that never wait for each other. The window's thread ([`window`]) owns winit, egui and a
//! device that draws the interface; it turns the user's input into a [`request::Request`] and shows the
//! newest picture. The render thread ([`render_thread`]) owns the device that renders, works on the newest
//! request, and leaves pictures in the [`outbox`]. Input is therefore handled within a frame of the interface,
//! however long the picture takes, and either device may be lost without the other.
//!
//! All modules but [`window`] and [`screen`] work without a window: [`OrbitCamera`](crate::staging::OrbitCamera) moves the camera,
//! [`setting_controls`] lists every setting with its help, [`crate::tonemap`] maps radiance to the display,
//! [`pace`] chooses the resolution of a moving picture, [`state`] holds the user's choices and writes the
//! command line that renders the same picture, and [`ui`] lays out the interface in egui.

pub mod engine;
pub mod outbox;
pub mod pace;
mod preview;
pub mod render_thread;
pub mod request;
pub mod screen;
pub mod setting_controls;
pub mod state;
pub mod ui;
pub mod window;
