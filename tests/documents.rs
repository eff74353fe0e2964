//! The documents: links lead somewhere, and code cites sections that exist. Needs no GPU.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Most lines of the README: it is for people who arrive.
const README_LINES: usize = 200;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Files below a folder with one of these endings.
fn files(folder: &str, endings: &[&str]) -> Vec<PathBuf> {
    let (mut out, mut open) = (Vec::new(), vec![root().join(folder)]);
    while let Some(folder) = open.pop() {
        for entry in std::fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else if path.extension().is_some_and(|e| endings.iter().any(|ending| e == *ending)) {
                out.push(path);
            }
        }
    }
    out
}

fn documents() -> Vec<PathBuf> {
    [files("docs", &["md"]), vec![root().join("README.md"), root().join("benches/peers/README.md")]].concat()
}

/// Lines of a document outside code blocks, with their numbers.
fn prose(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut code = false;
    (1..).zip(text.lines()).filter(move |(_, line)| {
        code ^= line.trim_start().starts_with("```");
        !code
    })
}

/// The anchor of a heading: lower case, words joined by dashes, no punctuation.
fn anchor(heading: &str) -> String {
    let kept = heading.trim().chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
    kept.collect::<String>().to_lowercase().replace(' ', "-")
}

/// Anchors of all headings of a document.
fn anchors(text: &str) -> BTreeSet<String> {
    let headings = prose(text).filter_map(|(_, line)| line.strip_prefix('#'));
    headings.map(|heading| anchor(heading.trim_start_matches('#'))).collect()
}

/// Targets of links and pictures in a line.
fn targets(line: &str) -> Vec<&str> {
    line.split("](").skip(1).filter_map(|rest| rest.split(')').next()).collect()
}

/// The reason for which a link of a document is wrong, if it is.
fn wrong_link(document: &Path, text: &str, target: &str) -> Option<String> {
    if target.contains("://") || target.starts_with("mailto:") {
        return None;
    }
    let (file, wanted) = target.split_once('#').map_or((target, None), |(file, anchor)| (file, Some(anchor)));
    let path = document.parent()?.join(file);
    if !file.is_empty() && !path.exists() {
        return Some(format!("{} is not there", path.display()));
    }
    let wanted = wanted?;
    let there = if file.is_empty() { text.to_owned() } else { std::fs::read_to_string(&path).ok()? };
    (!anchors(&there).contains(wanted)).then(|| format!("no heading #{wanted}"))
}

#[test]
fn links_lead_somewhere() {
    let (mut wrong, mut checked) = (Vec::new(), 0);
    for document in documents() {
        let text = std::fs::read_to_string(&document).unwrap();
        for (number, line) in prose(&text) {
            for target in targets(line) {
                checked += 1;
                let why = wrong_link(&document, &text, target);
                wrong.extend(why.map(|why| format!("{}:{number}: {target}: {why}", document.display())));
            }
        }
    }
    assert!(checked > 100, "{checked}");
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// Comments say `docs/method.md, section 4`.
#[test]
fn cited_sections_exist() {
    let (mut wrong, mut checked) = (Vec::new(), 0);
    let mut sections: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    let sources = ["src", "shaders", "tests"].map(|folder| files(folder, &["rs", "wesl"])).concat();
    let own = Path::new(file!()).file_name();
    for source in sources.into_iter().filter(|source| source.file_name() != own) {
        let text = std::fs::read_to_string(&source).unwrap();
        for line in text.lines() {
            for cited in line.split("docs/").skip(1) {
                let Some((name, rest)) = cited.split_once(".md") else { continue };
                let document = root().join("docs").join(name).with_extension("md");
                let headings = sections.entry(name.to_owned()).or_insert_with(|| {
                    let text = std::fs::read_to_string(&document).unwrap_or_default();
                    prose(&text).filter_map(|(_, l)| Some(l.strip_prefix("## ")?.to_owned())).collect()
                });
                checked += 1;
                if headings.is_empty() {
                    wrong.push(format!("{}: docs/{name}.md is not there", source.display()));
                }
                let number = rest
                    .strip_prefix(", section ")
                    .map(|rest| rest.chars().take_while(char::is_ascii_digit).collect::<String>());
                let is_there = |number: &String| headings.iter().any(|h| h.starts_with(&format!("{number} ")));
                if let Some(number) = number.filter(|number| !number.is_empty() && !is_there(number)) {
                    wrong.push(format!("{}: docs/{name}.md has no section {number}", source.display()));
                }
            }
        }
    }
    assert!(checked > 20, "{checked}");
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn the_readme_is_short() {
    let lines = std::fs::read_to_string(root().join("README.md")).unwrap().lines().count();
    assert!(lines <= README_LINES, "{lines} lines: move what is for later into docs/");
}

#[test]
fn planted_links_are_found() {
    let readme = root().join("README.md");
    let text = "# A title: it's `code`\n[x](#a-title-its-code) [y](docs/nowhere.md)\n```\n# no heading\n```";
    assert_eq!(anchors(text), BTreeSet::from(["a-title-its-code".to_owned()]));
    assert_eq!(targets(text.lines().nth(1).unwrap()), ["#a-title-its-code", "docs/nowhere.md"]);
    assert!(wrong_link(&readme, text, "docs/nowhere.md").is_some());
    assert!(wrong_link(&readme, text, "#nowhere").is_some());
    assert!(wrong_link(&readme, text, "#a-title-its-code").is_none());
    assert!(wrong_link(&readme, text, "https://example.org/x").is_none());
}
