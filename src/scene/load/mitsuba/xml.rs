//! The XML of a scene as one tree: `include`s are spliced in, `default`s substituted, and every element has
//! its file and line.
//!
//! A parameter keeps its first value, so a file that includes another overrides its defaults. Depth, number
//! of includes and number of elements are limited, because a file may include itself.

use std::borrow::Cow;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::scene::LoadError;
use crate::scene::load::files::{Files, find};

/// Maximum nesting depth of elements, including included files.
const MAX_DEPTH: usize = 64;
/// Maximum number of includes of one scene.
const MAX_INCLUDES: usize = 1000;
/// Maximum number of bytes of an attribute after substitution; parameters made of parameters grow
/// exponentially.
const MAX_VALUE: usize = 1 << 20;
/// Maximum number of elements of one scene.
const MAX_ELEMENTS: usize = 1 << 22;

/// One element with its attributes after substitution.
#[derive(Debug)]
pub(super) struct Element {
    /// Tag, such as `bsdf` or `float`; `lookAt` becomes `lookat`.
    pub tag: String,
    /// Elements inside it.
    pub children: Vec<Element>,
    /// True if the file's version is below 2, whose names are in camel case and some of whose defaults
    /// differ.
    pub legacy: bool,
    attributes: Vec<(String, String)>,
    file: Arc<Path>,
    line: usize,
}

impl Element {
    /// Returns an attribute's value after substitution.
    pub fn attribute(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(n, _)| n == name).map(|(_, v)| v.as_str())
    }

    /// Returns a mandatory attribute.
    pub fn required(&self, name: &str) -> Result<&str, LoadError> {
        self.attribute(name).ok_or_else(|| self.error(format!("<{}> needs the attribute `{name}`", self.tag)))
    }

    /// Returns the `name` attribute in snake case: `toWorld` becomes `to_world`, `intIOR` becomes `int_ior`.
    pub fn name(&self) -> Option<String> {
        self.attribute("name").map(snake_case)
    }

    /// Returns the plugin's name: the `type` attribute, or an empty string.
    pub fn plugin(&self) -> &str {
        self.attribute("type").unwrap_or_default()
    }

    /// Returns the element's title for messages: its id, or its type and line.
    pub fn title(&self) -> String {
        match self.attribute("id") {
            Some(id) => format!("{} `{id}`", self.tag),
            None => format!("{} `{}` ({})", self.tag, self.plugin(), self.place()),
        }
    }

    /// Returns the line, such as `line 12`.
    pub fn place(&self) -> String {
        format!("line {}", self.line)
    }

    /// Returns the file of the element.
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// Creates an error at this place.
    pub fn error(&self, cause: impl Into<String>) -> LoadError {
        LoadError::at(&*self.file, self.place(), cause)
    }
}

/// A scene's tree, and where the files are that it refers to.
pub(super) struct Tree<'a> {
    /// The `scene` element.
    pub root: Element,
    /// Where the files are.
    pub search: Search<'a>,
    /// Errors of `include` elements that name files that are not there. They are left out.
    pub missing: Vec<LoadError>,
}

/// Finds the files that elements refer to.
pub(super) struct Search<'a> {
    /// The files.
    pub files: &'a dyn Files,
    /// The folders that `path` elements name, besides the folder of the file that refers to a file.
    folders: Vec<PathBuf>,
}

impl<'a> Search<'a> {
    /// Finds a file that an element refers to: in the folder of the element's file, then in the search folders.
    pub fn find(&self, element: &Element, name: &str) -> Result<PathBuf, LoadError> {
        let beside = element.file().parent().unwrap_or(Path::new(""));
        let folders: Vec<&Path> = std::iter::once(beside).chain(self.folders.iter().map(PathBuf::as_path)).collect();
        find(self.files, &folders, name)
            .ok_or_else(|| element.error(format!("the file `{name}` does not exist in `{}`", beside.display())))
    }

    /// Finds a file as [`Self::find`] does, and reads it.
    pub fn read(&self, element: &Element, name: &str) -> Result<(PathBuf, Cow<'a, [u8]>), LoadError> {
        let path = self.find(element, name)?;
        let bytes = self.files.read(&path)?;
        Ok((path, bytes))
    }
}

/// Reads a scene file and everything that it includes.
pub(super) fn read<'a>(path: &Path, files: &'a dyn Files) -> Result<Tree<'a>, LoadError> {
    let search = Search { files, folders: path.parent().into_iter().map(Path::to_owned).collect() };
    let mut reader = Reader { parameters: Vec::new(), search, missing: Vec::new(), includes: 0, elements: 0 };
    let root = reader.file(path, 0)?;
    if root.tag != "scene" {
        return Err(root.error(format!("the root element is <{}>; a Mitsuba scene starts with <scene>", root.tag)));
    }
    let Reader { search, missing, .. } = reader;
    Ok(Tree { root, search, missing })
}

struct Reader<'a> {
    parameters: Vec<(String, String)>,
    search: Search<'a>,
    missing: Vec<LoadError>,
    includes: usize,
    elements: usize,
}

impl Reader<'_> {
    fn file(&mut self, path: &Path, depth: usize) -> Result<Element, LoadError> {
        let bytes = self.search.files.read(path)?;
        let text = std::str::from_utf8(&bytes).map_err(|e| {
            let line = 1 + bytes[..e.valid_up_to()].iter().filter(|&&b| b == b'\n').count();
            LoadError::at(path, format!("line {line}"), "is not UTF-8 text")
        })?;
        let document = roxmltree::Document::parse(text)
            .map_err(|e| LoadError::at(path, format!("line {}", e.pos().row), format!("is not valid XML: {e}")))?;
        let line_starts: Vec<usize> = std::iter::once(0)
            .chain(text.bytes().enumerate().filter(|&(_, b)| b == b'\n').map(|(i, _)| i + 1))
            .collect();
        let root = document.root_element();
        let major = root.attribute("version").and_then(|v| v.split('.').next()?.trim().parse::<u32>().ok());
        let source = Source { file: path.into(), line_starts, legacy: major.is_some_and(|v| v < 2) };
        self.element(root, &source, depth, false)
    }

    /// Reads an element. Parameters without a value are left as they stand in parts that are `unused` here.
    fn element(
        &mut self,
        node: roxmltree::Node,
        source: &Source,
        depth: usize,
        unused: bool,
    ) -> Result<Element, LoadError> {
        let unused = unused || matches!(node.tag_name().name(), "integrator" | "sampler" | "rfilter");
        let mut element = Element {
            tag: match node.tag_name().name() {
                "lookAt" => "lookat".to_owned(),
                tag => tag.to_owned(),
            },
            children: Vec::new(),
            legacy: source.legacy,
            attributes: Vec::new(),
            file: source.file.clone(),
            line: source.line_starts.partition_point(|&start| start <= node.range().start),
        };
        self.elements += 1;
        if depth > MAX_DEPTH || self.elements > MAX_ELEMENTS {
            return Err(element.error(format!(
                "the scene is nested deeper than {MAX_DEPTH} elements or has more than {MAX_ELEMENTS}; does it include itself?"
            )));
        }
        for attribute in node.attributes() {
            let value = match self.substitute(attribute.value()) {
                Err(_) if unused => attribute.value().to_owned(),
                value => value.map_err(|cause| element.error(cause))?,
            };
            // Where files' names ignore case, so do Mitsuba's plugins: `shapeGroup`.
            let value = if attribute.name() == "type" { value.to_ascii_lowercase() } else { value };
            element.attributes.push((attribute.name().to_owned(), value));
        }
        for child in node.children().filter(roxmltree::Node::is_element) {
            let child = self.element(child, source, depth + 1, unused)?;
            match child.tag.as_str() {
                "default" => self.default(&child)?,
                "include" => element.children.extend(self.include(&child, depth)?),
                "path" => {
                    let folder = Path::new(child.required("value")?);
                    self.search.folders.push(child.file().parent().unwrap_or(Path::new("")).join(folder));
                }
                _ => element.children.push(child),
            }
        }
        Ok(element)
    }

    fn default(&mut self, element: &Element) -> Result<(), LoadError> {
        let (name, value) = (element.required("name")?, element.required("value")?);
        if name.is_empty() {
            return Err(element.error("<default> needs a name that is not empty"));
        }
        if !self.parameters.iter().any(|(n, _)| n == name) {
            // The longest name comes first, so that `$spp_max` is not read as `$spp` with a suffix.
            let at = self.parameters.partition_point(|(n, _)| n.len() >= name.len());
            self.parameters.insert(at, (name.to_owned(), value.to_owned()));
        }
        Ok(())
    }

    fn include(&mut self, element: &Element, depth: usize) -> Result<Vec<Element>, LoadError> {
        self.includes += 1;
        if self.includes > MAX_INCLUDES {
            return Err(element.error(format!("more than {MAX_INCLUDES} includes; does the file include itself?")));
        }
        let path = match self.search.find(element, element.required("filename")?) {
            Ok(path) => path,
            Err(error) => {
                self.missing.push(error);
                return Ok(Vec::new());
            }
        };
        let included = self.file(&path, depth + 1)?;
        Ok(if included.tag == "scene" { included.children } else { vec![included] })
    }

    fn substitute(&self, value: &str) -> Result<String, String> {
        let mut out = String::with_capacity(value.len());
        let mut rest = value;
        while let Some(at) = rest.find('$') {
            out.push_str(&rest[..at]);
            rest = &rest[at + 1..];
            let Some((name, value)) = self.parameters.iter().find(|(name, _)| rest.starts_with(name.as_str())) else {
                let name: String = rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
                return Err(format!("the parameter `${name}` has no value; give it one with <default>"));
            };
            out.push_str(value);
            if out.len() > MAX_VALUE {
                return Err(format!("the value grows beyond {MAX_VALUE} bytes"));
            }
            rest = &rest[name.len()..];
        }
        out.push_str(rest);
        Ok(out)
    }
}

struct Source {
    file: Arc<Path>,
    line_starts: Vec<usize>,
    legacy: bool,
}

/// Returns all elements with an id, with the names defined by `alias`, and the errors of elements that refer to others.
pub(super) fn ids(root: &Element) -> Result<(HashMap<&str, &Element>, Vec<LoadError>), LoadError> {
    let mut ids: HashMap<&str, &Element> = HashMap::new();
    let (mut aliases, mut references, mut dangling) = (Vec::new(), Vec::new(), Vec::new());
    let mut stack = vec![root];
    while let Some(element) = stack.pop() {
        stack.extend(element.children.iter().rev());
        match (element.tag.as_str(), element.attribute("id")) {
            (_, None) => {}
            ("ref", Some(id)) => references.push((id, element)),
            ("alias", Some(id)) => aliases.push((id, element)),
            (_, Some(id)) => {
                if let Some(first) = ids.insert(id, element) {
                    return Err(element.error(format!(
                        "the id `{id}` is already taken by <{}> in `{}`, {}",
                        first.tag,
                        first.file().display(),
                        first.place()
                    )));
                }
            }
        }
    }
    let unknown = |id: &str, element: &Element| element.error(format!("nothing has the id `{id}`"));
    for (id, alias) in aliases {
        match ids.get(id) {
            Some(&target) => _ = ids.insert(alias.required("as")?, target),
            None => dangling.push(unknown(id, alias)),
        }
    }
    dangling.extend(references.into_iter().filter(|(id, _)| !ids.contains_key(id)).map(|(id, at)| unknown(id, at)));
    Ok((ids, dangling))
}

/// Converts `toWorld` to `to_world` and `intIOR` to `int_ior`.
fn snake_case(name: &str) -> String {
    let mut out = String::with_capacity(name.len() + 4);
    let mut previous = '_';
    for c in name.chars() {
        if c.is_ascii_uppercase() && previous.is_ascii_lowercase() {
            out.push('_');
        }
        out.push(c.to_ascii_lowercase());
        previous = c;
    }
    out
}
