//! The film.

pub mod accumulate;
