//! Intel Open Image Denoise, which is opened at run time: nothing is linked.

use std::ffi::{CStr, c_char, c_int, c_void};
use std::path::{Path, PathBuf};

use libloading::{Library, Symbol};

use super::Film;

/// Name of the library.
#[cfg(target_os = "linux")]
const NAME: &str = "libOpenImageDenoise.so.2";
#[cfg(target_os = "macos")]
const NAME: &str = "libOpenImageDenoise.2.dylib";
#[cfg(not(any(target_os = "linux", target_os = "macos")))]
const NAME: &str = "OpenImageDenoise.dll";

/// Environment variable that names the library or its folder.
pub const VARIABLE: &str = "LIGHTSHEAF_OIDN";

/// Values of the library's enumerations (oidn.h).
const DEVICE_CPU: c_int = 1;
const FORMAT_FLOAT3: c_int = 3;
const QUALITY_HIGH: c_int = 6;

type Device = *mut c_void;
type Filter = *mut c_void;

/// What is seen without noise, which keeps edges and textures sharp.
#[derive(Clone, Copy, Debug)]
pub struct Guides<'a> {
    /// Albedo of each pixel, 0 to 1.
    pub albedo: &'a [[f32; 3]],
    /// World normal of each pixel; zero where nothing is hit.
    pub normal: &'a [[f32; 3]],
}

/// An error of the denoiser.
#[derive(Debug, thiserror::Error)]
pub enum DenoiseError {
    /// The library was not found, or it is of another version.
    #[error(
        "Intel Open Image Denoise 2 cannot be opened ({0}); run `scripts/setup.sh --denoise`, which installs it, or name {NAME} by --oidn or \
         {VARIABLE}"
    )]
    Library(String),
    /// The library reports an error.
    #[error("Intel Open Image Denoise reports: {0}")]
    Failed(String),
}

/// Returns the file in which the library is looked for: that of the option, of the environment variable, or of
/// `scripts/setup.sh --denoise`; otherwise the name for the system's search.
fn library_path(option: Option<&Path>) -> PathBuf {
    let within = |path: PathBuf| if path.is_dir() { path.join(NAME) } else { path };
    let set = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    if let Some(path) = option.map(Path::to_owned).or_else(|| set(VARIABLE)) {
        return within(path);
    }
    let data = set("XDG_DATA_HOME").or_else(|| Some(set("HOME")?.join(".local/share")));
    let installed = data.map(|data| data.join("lightsheaf/oidn/lib").join(NAME)).filter(|path| path.exists());
    installed.unwrap_or_else(|| PathBuf::from(NAME))
}

/// Denoises a picture of linear radiance with high quality.
///
/// # Errors
/// [`DenoiseError::Library`] if the library cannot be opened, [`DenoiseError::Failed`] if it fails or if guides have
/// another number of pixels.
pub fn denoise(film: &Film, guides: Option<Guides>, library: Option<&Path>) -> Result<Film, DenoiseError> {
    let sizes = guides.map_or([film.pixels.len(); 2], |guides| [guides.albedo.len(), guides.normal.len()]);
    if sizes != [film.width as usize * film.height as usize; 2] || film.pixels.len() != sizes[0] {
        return Err(DenoiseError::Failed("albedo and normals are of another size than the picture".to_owned()));
    }
    run(film, guides, &library_path(library))
}

#[expect(unsafe_code, reason = "the library has a C interface")]
fn run(film: &Film, guides: Option<Guides>, path: &Path) -> Result<Film, DenoiseError> {
    let missing = |error: libloading::Error| DenoiseError::Library(format!("{}: {error}", path.display()));
    let mut out = film.clone();
    // SAFETY: the names and signatures are those of oidn.h of version 2. All images have `width * height` pixels
    // of three floats, outlive the filter, and only `out` is written. Device and filter are released once.
    unsafe {
        let library = Library::new(path).map_err(missing)?;
        let new_device: Symbol<unsafe extern "C" fn(c_int) -> Device> =
            library.get(b"oidnNewDevice\0").map_err(missing)?;
        let commit_device: Symbol<unsafe extern "C" fn(Device)> =
            library.get(b"oidnCommitDevice\0").map_err(missing)?;
        let error: Symbol<unsafe extern "C" fn(Device, *mut *const c_char) -> c_int> =
            library.get(b"oidnGetDeviceError\0").map_err(missing)?;
        let new_filter: Symbol<unsafe extern "C" fn(Device, *const c_char) -> Filter> =
            library.get(b"oidnNewFilter\0").map_err(missing)?;
        let set_image: Symbol<
            unsafe extern "C" fn(Filter, *const c_char, *mut c_void, c_int, usize, usize, usize, usize, usize),
        > = library.get(b"oidnSetSharedFilterImage\0").map_err(missing)?;
        let set_bool: Symbol<unsafe extern "C" fn(Filter, *const c_char, bool)> =
            library.get(b"oidnSetFilterBool\0").map_err(missing)?;
        let set_int: Symbol<unsafe extern "C" fn(Filter, *const c_char, c_int)> =
            library.get(b"oidnSetFilterInt\0").map_err(missing)?;
        let commit_filter: Symbol<unsafe extern "C" fn(Filter)> =
            library.get(b"oidnCommitFilter\0").map_err(missing)?;
        let execute: Symbol<unsafe extern "C" fn(Filter)> = library.get(b"oidnExecuteFilter\0").map_err(missing)?;
        let release_filter: Symbol<unsafe extern "C" fn(Filter)> =
            library.get(b"oidnReleaseFilter\0").map_err(missing)?;
        let release_device: Symbol<unsafe extern "C" fn(Device)> =
            library.get(b"oidnReleaseDevice\0").map_err(missing)?;

        let device = new_device(DEVICE_CPU);
        commit_device(device);
        let filter = new_filter(device, c"RT".as_ptr());
        let image = |name: &CStr, pixels: *const [f32; 3]| {
            let (width, height) = (film.width as usize, film.height as usize);
            set_image(filter, name.as_ptr(), pixels.cast_mut().cast(), FORMAT_FLOAT3, width, height, 0, 0, 0);
        };
        image(c"color", film.pixels.as_ptr());
        if let Some(guides) = guides {
            image(c"albedo", guides.albedo.as_ptr());
            image(c"normal", guides.normal.as_ptr());
        }
        image(c"output", out.pixels.as_mut_ptr());
        set_bool(filter, c"hdr".as_ptr(), true);
        set_int(filter, c"quality".as_ptr(), QUALITY_HIGH);
        commit_filter(filter);
        execute(filter);
        let mut message = std::ptr::null();
        let code = error(device, &raw mut message);
        let text =
            if message.is_null() { String::new() } else { CStr::from_ptr(message).to_string_lossy().into_owned() };
        release_filter(filter);
        release_device(device);
        if code != 0 {
            return Err(DenoiseError::Failed(text));
        }
    }
    Ok(out)
}
