//! Decoders of compressed meshes, which know nothing of the file around them.

pub mod draco;
pub mod meshopt;
