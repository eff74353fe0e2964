//! Why a scene could not be loaded.

use std::path::PathBuf;

/// A file, the place in it where there is one, and the cause with what to do about it.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{}{}: {cause}", path.display(), place.as_ref().map(|p| format!(", {p}")).unwrap_or_default())]
pub struct LoadError {
    /// The file at fault (which may be one that the scene refers to).
    pub path: PathBuf,
    /// Line, JSON path or element, such as `line 12` or `accessors[3]`.
    pub place: Option<String>,
    /// What is wrong and what to do.
    pub cause: String,
}

impl LoadError {
    /// An error about the file as a whole.
    pub fn new(path: impl Into<PathBuf>, cause: impl Into<String>) -> Self {
        Self { path: path.into(), place: None, cause: cause.into() }
    }

    /// An error about one place in the file.
    pub fn at(path: impl Into<PathBuf>, place: impl Into<String>, cause: impl Into<String>) -> Self {
        Self { path: path.into(), place: Some(place.into()), cause: cause.into() }
    }
}
