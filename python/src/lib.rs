//! The compiled part of the Python package `lightsheaf`: commands by the words of the command line, and pictures as
//! bytes. `python/lightsheaf/__init__.py` makes words of Python's arguments, and arrays of bytes.

use std::ffi::OsString;
use std::path::Path;
use std::sync::mpsc;
use std::thread;
use std::time::Duration;

use lightsheaf::cli::embedded::{self, Interrupt, Loaded};
use lightsheaf::film::exr::Picture;
use lightsheaf::film::{Film, has_extension};
use lightsheaf::metrics;
use pyo3::create_exception;
use pyo3::exceptions::{PyException, PyRuntimeError, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::PyByteArray;

create_exception!(
    lightsheaf,
    Error,
    PyException,
    "An error of the program: nothing was rendered, or it could not go on."
);

/// Interval at which Python's signal handlers run while a command works.
const POLL: Duration = Duration::from_millis(50);

/// Rows and columns of a picture, its colours in float32, and its other channels with their names.
type Pixels<'py> = ([u32; 2], Bound<'py, PyByteArray>, Vec<(String, Bound<'py, PyByteArray>)>);

/// A scene's file in memory.
#[pyclass(frozen, name = "Loaded")]
struct LoadedScene(Loaded);

#[pymethods]
impl LoadedScene {
    /// Returns the name of the scene.
    #[getter]
    fn name(&self) -> &str {
        &self.0.scene().name
    }

    /// Returns the names of the cameras of the file.
    #[getter]
    fn cameras(&self) -> Vec<String> {
        self.0.scene().cameras.iter().map(|camera| camera.name.clone()).collect()
    }

    /// Returns what the file has and the renderer does not.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.0.scene().warnings.clone()
    }
}

/// Returns the exception of an error: `TypeError` for words that are no options, as for arguments of any function.
fn exception(error: &anyhow::Error) -> PyErr {
    match error.downcast_ref::<clap::Error>() {
        Some(error) => {
            let text = error.to_string();
            let message = text.strip_prefix("error: ").unwrap_or(&text).split("\n\nUsage:").next().unwrap_or_default();
            PyTypeError::new_err(message.split("\n\nFor more information").next().unwrap_or_default().to_owned())
        }
        None => Error::new_err(format!("{error:#}")),
    }
}

/// Runs `work` on a thread of its own without Python's lock. Signal handlers run meanwhile: if one raises, as that of
/// Ctrl-C does, the work is asked to stop, and the exception is raised once it has.
fn run<T: Send + 'static>(
    py: Python,
    work: impl FnOnce(&Interrupt) -> anyhow::Result<T> + Send + 'static,
) -> PyResult<T> {
    let interrupt = Interrupt::default();
    let (sender, receiver) = mpsc::channel();
    let asked = interrupt.clone();
    let worker = thread::Builder::new().name("lightsheaf".to_owned()).spawn(move || {
        // The receiver waits until this thread has ended.
        let _ = sender.send(work(&asked));
    })?;
    let (mut receiver, mut raised) = (receiver, None);
    let done = loop {
        let received;
        (received, receiver) = py.detach(move || (receiver.recv_timeout(POLL), receiver));
        if !matches!(received, Err(mpsc::RecvTimeoutError::Timeout)) {
            break received.ok();
        }
        if let Err(exception) = py.check_signals() {
            interrupt.request();
            raised.get_or_insert(exception);
        }
    };
    let ended = py.detach(|| worker.join());
    match (raised, done, ended) {
        (Some(exception), ..) => Err(exception),
        (None, Some(done), Ok(())) => done.map_err(|error| exception(&error)),
        _ => Err(PyRuntimeError::new_err("the renderer has panicked; please report the scene and the options")),
    }
}

/// Makes a command line of Python's words.
fn words_of(words: Vec<String>) -> Vec<OsString> {
    words.into_iter().map(OsString::from).collect()
}

/// Returns a picture as bytes.
fn channels<'py>(py: Python<'py>, picture: &Picture) -> Pixels<'py> {
    let bytes = |values: &mut dyn Iterator<Item = f32>| -> Vec<u8> { values.flat_map(f32::to_ne_bytes).collect() };
    let Film { width, height, pixels } = &picture.film;
    let colours = PyByteArray::new(py, &bytes(&mut pixels.iter().flatten().copied()));
    let others = picture
        .channels
        .iter()
        .map(|channel| (channel.name.clone(), PyByteArray::new(py, &bytes(&mut channel.values.iter().copied()))));
    ([*height, *width], colours, others.collect())
}

/// Reads an image file with its layers, if it has any.
fn picture_of(path: &Path) -> anyhow::Result<Picture> {
    if has_extension(path, "exr") {
        return Ok(Picture::load(path)?);
    }
    Ok(Picture { film: Film::load(path)?, ..Picture::default() })
}

/// Returns a film of the float32 values of rows, columns and three channels.
fn film((shape, values): &([u32; 2], Vec<u8>)) -> Film {
    let value = |bytes: &[u8]| bytes.try_into().map(f32::from_ne_bytes).unwrap_or_default();
    let pixels = values.chunks_exact(12).map(|pixel| [0, 4, 8].map(|at| value(&pixel[at..at + 4]))).collect();
    Film { width: shape[1], height: shape[0], pixels }
}

/// Lightsheaf's commands. `lightsheaf` is the package to use.
#[pymodule(name = "_lightsheaf")]
mod module {
    use super::{
        Bound, Error, LoadedScene, Path, Pixels, PyModule, PyModuleMethods as _, PyResult, Python, channels, embedded,
        film, metrics, picture_of, pyfunction, run, words_of,
    };

    /// Loads the file of the scene that the words of `render` name.
    #[pyfunction]
    fn load(py: Python, words: Vec<String>) -> PyResult<LoadedScene> {
        let words = words_of(words);
        run(py, move |_| embedded::load(&words)).map(LoadedScene)
    }

    /// Renders the picture that the words of `render` ask for.
    #[pyfunction]
    #[pyo3(signature = (words, loaded=None))]
    fn render<'py>(
        py: Python<'py>,
        words: Vec<String>,
        loaded: Option<&Bound<'py, LoadedScene>>,
    ) -> PyResult<Pixels<'py>> {
        let (words, loaded) = (words_of(words), loaded.map(|loaded| loaded.get().0.clone()));
        let picture = run(py, move |interrupt| embedded::picture(&words, loaded, interrupt))?;
        Ok(channels(py, &picture))
    }

    /// Reads an image file.
    #[pyfunction]
    fn read<'py>(py: Python<'py>, path: String) -> PyResult<Pixels<'py>> {
        let picture = run(py, move |_| picture_of(Path::new(&path)))?;
        Ok(channels(py, &picture))
    }

    /// Compares two images and returns the metrics as JSON.
    #[pyfunction]
    fn compare(py: Python, image: ([u32; 2], Vec<u8>), reference: ([u32; 2], Vec<u8>)) -> PyResult<String> {
        run(py, move |_| {
            let comparison = metrics::compare(&film(&image), &film(&reference))?;
            Ok(serde_json::to_string(&comparison)?)
        })
    }

    /// Runs a command that writes files.
    #[pyfunction]
    fn command(py: Python, words: Vec<String>) -> PyResult<()> {
        let words = words_of(words);
        run(py, move |_| embedded::run(&words))
    }

    /// Returns name, help, and whether it may be given several times, of each option of a command.
    #[pyfunction]
    fn options(command: &str) -> Vec<(String, String, bool)> {
        embedded::options(command).into_iter().map(|option| (option.name, option.help, option.repeats)).collect()
    }

    #[pymodule_init]
    fn init(module: &Bound<PyModule>) -> PyResult<()> {
        module.add("Error", module.py().get_type::<Error>())?;
        module.add_class::<LoadedScene>()
    }
}
