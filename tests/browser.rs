//! The page of `web/` in a real browser, whose WebGPU runs on the CPU: its pictures are those of the program.
//! `scripts/web.sh --build` writes the page, and `scripts/setup.sh --tests` installs the browser.

mod common;

use std::io::Write as _;
use std::path::Path;
use std::process::Command;

use common::browser::{Browser, Site};
use common::folder::Folder;
use common::{gpu, shared, skip};
use lightsheaf::film::Film;
use lightsheaf::film::exr::Picture;
use lightsheaf::metrics;

/// Largest rel_mse between the browser's picture and the program's at equal seed: both draw the same paths, and
/// only a rounded bit decides otherwise here and there.
const SAME: f64 = 1e-5;

/// Returns the files of the page. Without them, the test is skipped.
fn site() -> Option<Site> {
    let target = std::env::current_exe().unwrap();
    let page = target.ancestors().nth(3).unwrap().join("page");
    let Ok(entries) = std::fs::read_dir(&page) else {
        skip("REQUIRE_BROWSER", &format!("{} is not there: scripts/web.sh --build writes it", page.display()));
        return None;
    };
    let file = |path: &Path| (path.file_name().unwrap().to_str().unwrap().to_owned(), std::fs::read(path).unwrap());
    Some(entries.map(|entry| file(&entry.unwrap().path())).collect())
}

/// The browser's own software Vulkan, where the package of Debian has it: other drivers round otherwise, and
/// rasterize silhouettes with another precision.
const DRIVER: &str = "/usr/lib/chromium/vk_swiftshader_icd.json";

/// Renders a scene by the program with the page's driver.
fn native(folder: &Folder, scene: &str, options: &str) -> Film {
    let out = folder.path("native.exr");
    let mut program = Command::new(env!("CARGO_BIN_EXE_lightsheaf"));
    program.args(["render", scene, "--quiet", "-o", &out]).args(options.split(' '));
    if Path::new(DRIVER).is_file() {
        program.env("VK_DRIVER_FILES", DRIVER);
    }
    let run = program.output().unwrap();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    Film::load(out).unwrap()
}

fn check(name: &str, posted: &[u8], expected: &Film) {
    let film = Picture::decode(posted).unwrap().film;
    let comparison = metrics::compare(&film, expected).unwrap();
    println!("{name}: rel_mse {:.2e}, mean {:+.1e}", comparison.rel_mse, comparison.mean_bias);
    assert!(comparison.rel_mse <= SAME, "{name}: {comparison:?}");
}

/// Most bytes of the page's module, compressed by gzip.
const MOST_BYTES: usize = 3_000_000;

#[test]
fn the_page_is_small() {
    let Some(site) = site() else { return };
    let mut compressed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::best());
    compressed.write_all(&site["lightsheaf_web_bg.wasm"]).unwrap();
    let bytes = compressed.finish().unwrap().len();
    println!("{bytes} bytes");
    assert!((MOST_BYTES / 10..=MOST_BYTES).contains(&bytes), "{bytes}");
}

#[test]
fn pictures_are_those_of_the_program() {
    let (Some(browser), Some(site), Some(_)) = (Browser::find(), site(), gpu()) else { return };
    let folder = Folder::new("browser");
    let cases = [
        ("cornell_point", "shared", "exact"),
        ("cornell_area", "shared", "exact"),
        ("cornell_mirrors", "shared", "exact"),
        ("cornell_glossy", "bdpt", "exact"),
        ("cornell_env", "path", "exact"),
        ("corner_spikes", "path", "bvh"),
    ];
    for (scene, method, visibility) in cases {
        let page = format!(
            "index.html?scene={scene}&method={method}&visibility={visibility}&size=96x64&bounces=3&samples=16&seed=5&post=/done"
        );
        let options =
            format!("--method {method} --visibility {visibility} --size 96x64 --bounces 3 --samples 16 --seed 5");
        let posted = browser.visit(&site, &page, 1);
        check(scene, &posted[0], &native(&folder, &format!("builtin:{scene}"), &options));
    }
}

/// A page around the page, which drops a file on it.
const DROP: &str = r#"<!doctype html>
<iframe src="index.html?scene=cornell_point&size=320x240&bounces=2&samples=2&seed=1&post=/done" width="900" height="600"></iframe>
<script type="module">
  const frame = document.querySelector("iframe");
  await new Promise(resolve => frame.addEventListener("load", resolve));
  const bytes = await (await fetch("dropped.glb")).arrayBuffer();
  // The scene of the address is rendered first.
  const status = frame.contentDocument.getElementById("status");
  while (!status.textContent.startsWith("2 samples")) await new Promise(resolve => setTimeout(resolve, 50));
  const { File, DataTransfer, DragEvent } = frame.contentWindow;
  const dataTransfer = new DataTransfer();
  dataTransfer.items.add(new File([bytes], "dropped.glb"));
  frame.contentDocument.dispatchEvent(new DragEvent("drop", { dataTransfer, bubbles: true, cancelable: true }));
</script>
"#;

#[test]
fn a_dropped_file_is_rendered() {
    let (Some(browser), Some(mut site), Some(_), Some(shared)) = (Browser::find(), site(), gpu(), shared()) else {
        return;
    };
    let file = shared.join("scenes/gltf/BoxTextured/glTF-Binary/BoxTextured.glb");
    site.insert("drop.html".to_owned(), DROP.into());
    site.insert("dropped.glb".to_owned(), std::fs::read(&file).unwrap());
    let folder = Folder::new("drop");
    let posted = browser.visit(&site, "drop.html", 2);
    let options = "--size 320x240 --bounces 2 --samples 2 --seed 1";
    check("cornell_point", &posted[0], &native(&folder, "builtin:cornell_point", options));
    check("dropped.glb", &posted[1], &native(&folder, file.to_str().unwrap(), options));
}
