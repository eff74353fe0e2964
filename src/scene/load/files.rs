//! The files that a scene is loaded from: on the disk, or in memory.

use std::borrow::Cow;
use std::path::{Component, Path, PathBuf};

use crate::scene::LoadError;

/// A place where files are. Loaders ask it for a scene's file, and for those that this file refers to.
pub trait Files: Sync {
    /// True if there is such a file.
    fn has(&self, path: &Path) -> bool;

    /// Returns the bytes of a file.
    ///
    /// # Errors
    /// A file that is missing or cannot be read is an error with its path.
    fn read(&self, path: &Path) -> Result<Cow<'_, [u8]>, LoadError>;
}

/// Finds a file that another one refers to, in the first of some folders that has it: by the path that stands there,
/// whose `\` of Windows is a `/`, or else by its mere name, since paths of another machine lead nowhere here.
pub(super) fn find(files: &dyn Files, folders: &[&Path], name: &str) -> Option<PathBuf> {
    let portable = name.replace('\\', "/");
    let mere = portable.rsplit('/').next().unwrap_or_default();
    let spellings = [name, &portable, mere];
    spellings.iter().flat_map(|name| folders.iter().map(move |folder| folder.join(name))).find(|path| files.has(path))
}

/// Most bytes of a path that is looked for in another case, as on Linux, where no path is longer.
const LONGEST_PATH: usize = 4096;

/// The file system. Names count as equal when they differ in the case of letters alone and no file has the name
/// itself: scenes come from systems where they are.
pub struct Disk;

impl Disk {
    /// Returns the path under which the file system has something, or the path itself.
    fn actual(path: &Path) -> PathBuf {
        let short = path.as_os_str().len() <= LONGEST_PATH;
        short.then(|| Self::in_any_case(path)).flatten().unwrap_or_else(|| path.to_owned())
    }

    fn in_any_case(path: &Path) -> Option<PathBuf> {
        if path.exists() {
            return Some(path.to_owned());
        }
        let name = path.file_name()?.to_str()?.to_lowercase();
        let parent = path.parent().filter(|parent| !parent.as_os_str().is_empty());
        let folder = Self::in_any_case(parent.unwrap_or(Path::new(".")))?;
        let entries = std::fs::read_dir(folder).ok()?.filter_map(|entry| Some(entry.ok()?.path()));
        entries.filter(|entry| entry.file_name().is_some_and(|n| n.to_string_lossy().to_lowercase() == name)).min()
    }
}

impl Files for Disk {
    fn has(&self, path: &Path) -> bool {
        Self::actual(path).is_file()
    }

    /// Reads a regular file; devices and pipes, which may never end, are errors.
    fn read(&self, path: &Path) -> Result<Cow<'_, [u8]>, LoadError> {
        let failed = |e: std::io::Error| LoadError::new(path, format!("cannot be read: {e}"));
        let actual = Self::actual(path);
        if !std::fs::metadata(&actual).map_err(failed)?.is_file() {
            return Err(LoadError::new(path, "cannot be read: it is not a regular file"));
        }
        let bytes = std::fs::read(&actual).map_err(failed)?;
        if bytes.starts_with(b"version https://git-lfs.github.com/spec/") {
            return Err(LoadError::new(path, "only stands for a file of Git LFS: fetch that with `git lfs pull`"));
        }
        Ok(Cow::Owned(bytes))
    }
}

/// Returns the bytes of a file by its path from the scene's folder, such as `textures/wood.png`; none if there is
/// no such file. Absolute paths stay as the scene has them.
pub type Resolver<'a> = dyn Fn(&str) -> Option<Vec<u8>> + Sync + 'a;

/// A scene's file in memory, and what it refers to by a function.
pub struct InMemory<'a> {
    /// Path of the file, which may be its mere name.
    pub path: &'a Path,
    /// Its contents.
    pub bytes: &'a [u8],
    /// The other files.
    pub resolver: &'a Resolver<'a>,
}

impl InMemory<'_> {
    fn resolve(&self, path: &Path) -> Option<Cow<'_, [u8]>> {
        if path == self.path {
            return Some(Cow::Borrowed(self.bytes));
        }
        let folder = self.path.parent().unwrap_or(Path::new(""));
        let beside = path.strip_prefix(folder).unwrap_or(path);
        let plain: PathBuf = beside.components().filter(|part| *part != Component::CurDir).collect();
        (self.resolver)(&plain.to_string_lossy().replace('\\', "/")).map(Cow::Owned)
    }
}

impl Files for InMemory<'_> {
    fn has(&self, path: &Path) -> bool {
        self.resolve(path).is_some()
    }

    fn read(&self, path: &Path) -> Result<Cow<'_, [u8]>, LoadError> {
        let missing = "is missing: give it together with the file that refers to it, or embed it there";
        self.resolve(path).ok_or_else(|| LoadError::new(path, missing))
    }
}
