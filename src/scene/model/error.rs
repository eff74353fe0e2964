//! Errors of scene loading.

use std::path::PathBuf;

/// A loading error: the file, the place in it if there is one, and the cause together with its remedy.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{}{}: {cause}", path.display(), place.as_ref().map(|p| format!(", {p}")).unwrap_or_default())]
pub struct LoadError {
    /// The file at fault (which may be one that the scene refers to).
    pub path: PathBuf,
    /// Line, JSON path or element, such as `line 12` or `accessors[3]`.
    pub place: Option<String>,
    /// Description of the error and of its remedy.
    pub cause: String,
}

impl LoadError {
    /// Creates an error about the file as a whole.
    pub fn new(path: impl Into<PathBuf>, cause: impl Into<String>) -> Self {
        Self { path: path.into(), place: None, cause: cause.into() }
    }

    /// Creates an error about one place in the file.
    pub fn at(path: impl Into<PathBuf>, place: impl Into<String>, cause: impl Into<String>) -> Self {
        Self { path: path.into(), place: Some(place.into()), cause: cause.into() }
    }
}
