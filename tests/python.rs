//! The Python package in `python/`: it is built, tested, and runs the examples of docs/python.md.

mod common;

use std::path::Path;
use std::process::Command;

use common::skip;

/// Exit status of the script where Python, or what it needs, is not there.
const LACKING: i32 = 3;

#[test]
fn the_package_is_built_and_passes_its_tests() {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("python/test.sh");
    let run = Command::new(&script).output();
    let run = match run {
        Ok(run) => run,
        Err(e) => return skip("REQUIRE_PYTHON", &format!("{} does not run: {e}", script.display())),
    };
    let messages = String::from_utf8_lossy(&run.stderr);
    println!("{}{messages}", String::from_utf8_lossy(&run.stdout));
    if run.status.code() == Some(LACKING) {
        return skip("REQUIRE_PYTHON", messages.lines().last().unwrap_or_default());
    }
    assert!(run.status.success(), "{messages}");
    assert!(messages.contains("test_the_examples_run"), "the tests were found: {messages}");
}
