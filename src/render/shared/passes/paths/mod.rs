//! Eye subpaths: connections and extensions.

pub mod connect;
pub mod extend;
