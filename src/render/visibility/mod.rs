//! The data structures of visibility queries: lists and depth maps of views, or acceleration structures.

pub mod acceleration;
pub mod view;
