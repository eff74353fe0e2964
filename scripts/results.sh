#!/usr/bin/env bash
# Makes every table of docs/results.md that needs no file from outside, and the curve of the README: scripts/results.sh [BLOCK...]
#
# Each block between `<!-- made by scripts/results.sh: NAME -->` and `<!-- end -->` is replaced, with commit, date, machine and
# command above the table. Without BLOCK all of the first list are made; on two cores without a GPU that takes about two hours.
#
#   plan stress twins methods strategies sides halls resolution     by the built program
#   study moving                                                    by the built program, into docs/study.md
#   tests                                                           by cargo: the tests that print tables; hours
#
# Tables without such a mark need scenes or programs from outside; docs/results.md says from where.
#
#   LIGHTSHEAF   the program (default: target/debug/lightsheaf, which has to be built)
#   SIZE         pictures (default: 512x512)
#   BUDGET       seconds for each method, scene and repeat of a benchmark (default: 20)
#   REPEATS      repeats of a benchmark (default: 3)
#   REFERENCE    options of `lightsheaf bench` that choose the reference, such as --reference-method ray-query
#   TEXTURED     a scene with textures for the study, such as PATH/Sponza.gltf (default: none)
#   OUT          the page that is rewritten (default: docs/results.md; docs/study.md for study and moving)
set -euo pipefail

cd "$(dirname "${BASH_SOURCE[0]}")/.."
lightsheaf=${LIGHTSHEAF:-${CARGO_TARGET_DIR:-target}/debug/lightsheaf}
[[ -x $lightsheaf ]] || { echo "error: $lightsheaf is not there: cargo build, or set LIGHTSHEAF" >&2; exit 2; }
size=${SIZE:-512x512}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
[[ $# -gt 0 ]] || set -- plan stress twins methods strategies sides halls resolution
read -ra reference <<<"${REFERENCE:-}"
cornell=(builtin:cornell_point builtin:cornell_area builtin:corner_spikes)

# bench OPTIONS...: the command is kept for the page.
bench() {
    local options=("$@" --size "$size" --budget "${BUDGET:-20}" --repeats "${REPEATS:-3}" ${reference[@]+"${reference[@]}"})
    "$lightsheaf" bench "${options[@]}" -o "$work/bench" --quiet
    command="lightsheaf bench$(printf ' %q' "${options[@]}") -o DIR"
}
# variants NAME=OPTIONS...: as options of bench.
variants() {
    chosen=(--methods raster)
    for variant in "$@"; do chosen+=(--variant "${variant%%=*}=--method raster ${variant#*=}"); done
}

# Every estimator with every visibility: NAME=OPTIONS.
everything=()
for visibility in "lists=exact --visibility-from lists" "grid=exact --visibility-from grid" "depth maps=fast" "BVH=bvh" \
    "ray queries=ray-query"; do
    everything+=("shared, ${visibility%%=*}=--method shared --visibility ${visibility#*=}")
done
for method in bdpt path; do
    for visibility in "grid=exact" "BVH=bvh" "ray queries=ray-query"; do
        everything+=("$method, ${visibility%%=*}=--method $method --visibility ${visibility#*=}")
    done
done

# The device, as the program names it.
"$lightsheaf" stress --short --json "one pixel" >"$work/device.json"

for block in "$@"; do
    case $block in
        plan)
            for scene in cornell_point cornell_area cornell_env corner_spikes cornell_glossy displaced_room:10000 \
                displaced_room:1000000 emitter_hall:10000 point_hall:100000; do
                "$lightsheaf" plan "builtin:$scene" --size "$size" >"$work/plan.$scene"
            done
            command="lightsheaf plan builtin:NAME --size $size"
            ;;
        stress)
            # A case that is wrong is a result, too.
            "$lightsheaf" stress --short --json >"$work/stress.json" || [[ $? -eq 1 ]]
            command="lightsheaf stress --short --json"
            ;;
        twins)
            one=(--size "$size" --samples 64 --interleave 1 --quiet)
            for scene in cornell_point corner_spikes cornell_glossy displaced_room:60000; do
                "$lightsheaf" render "builtin:$scene" --method twin "${one[@]}" -o "$work/twin.exr"
                for visibility in exact fast; do
                    "$lightsheaf" render "builtin:$scene" --visibility $visibility "${one[@]}" -o "$work/raster.exr"
                    "$lightsheaf" compare "$work/raster.exr" "$work/twin.exr" --json >"$work/twins.$scene.$visibility"
                done
            done
            command="lightsheaf render builtin:NAME ${one[*]} --visibility exact (or fast; and --method twin); lightsheaf compare"
            ;;
        methods)
            bench "${cornell[@]}" builtin:cornell_glossy --methods raster,twin,ray-query,path,reference \
                --variant "raster, fast=--method raster --visibility fast" \
                --variant "raster, one subpath=--method raster --interleave 1"
            ;;
        strategies)
            variants "all=--interleave 1" "vpl=--strategies vpl" "bundle=--strategies bundle" "paper=--strategies paper"
            bench "${cornell[@]}" builtin:cornell_env "${chosen[@]}"
            ;;
        sides)
            variants 1="--interleave 1" 2="--interleave 2" 3="--interleave 3" 4="--interleave 4" 6="--interleave 6"
            bench builtin:cornell_point builtin:cornell_area builtin:cornell_glossy "${chosen[@]}"
            ;;
        halls)
            variants "uniform=--interleave 1 --light-sampling uniform" "power=--interleave 1 --light-sampling power" \
                "view, one point=--interleave 1 --light-pool 1" "view, 16 points=--interleave 1" \
                "restir=--light-sampling restir"
            size=${SIZE:-128x128} bench builtin:emitter_hall:10000 builtin:point_hall:100000 "${chosen[@]}"
            ;;
        resolution)
            for texels in 64 128 256 512; do
                sized+=("$texels=--interleave 1 --bundle-resolution $texels --light-resolution $texels --vpl-resolution $texels")
            done
            variants "${sized[@]}"
            bench builtin:cornell_point builtin:displaced_room:60000 "${chosen[@]}"
            ;;
        study)
            scenes=(builtin:cornell_area ${TEXTURED:+"$TEXTURED"} builtin:cornell_glossy builtin:cornell_spheres builtin:emitter_hall:10000)
            chosen=()
            for one in "${everything[@]}"; do chosen+=(--variant "$one"); done
            bench "${scenes[@]}" "${chosen[@]}" --targets 0.01
            ;;
        moving)
            for one in "${everything[@]}"; do
                read -ra options <<<"${one#*=}"
                mkdir -p "$work/moving/${one%%=*}"
                "$lightsheaf" render builtin:sea --size "$size" --samples 1 --interleave 1 --frames 0..6 --fps 24 --quiet \
                    "${options[@]}" -o "$work/frame.exr" --stats "$work/moving/${one%%=*}/frame.json"
            done
            command="lightsheaf render builtin:sea --size $size --samples 1 --interleave 1 --frames 0..6 --fps 24 OPTIONS -o OUT.exr --stats STATS.json"
            ;;
        tests)
            for test in "visibility -- table" "raster_statistics -- pixels" "planted -- table" "paths -- matrix"; do
                cargo test --locked --test ${test/ -- / -- --ignored --nocapture } | grep '^| ' >>"$work/tests" || true
            done
            command="cargo test --test visibility (raster_statistics, planted, paths) -- --ignored --nocapture"
            ;;
        *) echo "error: there is no block $block" >&2; exit 2 ;;
    esac
    page=docs/results.md
    if [[ $block == study || $block == moving ]]; then page=docs/study.md; fi
    python3 - "$block" "$work" "${OUT:-$page}" "$command" <<'PYTHON'
import datetime, json, os, pathlib, re, statistics, subprocess, sys
block, work, page, command = sys.argv[1], pathlib.Path(sys.argv[2]), pathlib.Path(sys.argv[3]), sys.argv[4]


def git(*words):
    return subprocess.run(["git", *words], capture_output=True, text=True).stdout.strip()


def row(*cells):
    return "| " + " | ".join(str(cell).replace("|", "\\|") for cell in cells) + " |"


cpuinfo = pathlib.Path("/proc/cpuinfo")
cpu = re.search(r"model name\s*: (.*)", cpuinfo.read_text() if cpuinfo.exists() else "")
commit = git("rev-parse", "--short", "HEAD") + (" with changes" if git("status", "--porcelain", "--", ".", ":!docs/results.md") else "")
device = json.loads((work / "device.json").read_text())["device"]
lines = [f"Commit {commit}, {datetime.date.today()}; {cpu.group(1) if cpu else 'unknown processor'}, "
         f"{os.cpu_count()} threads; {device}.", "", f"    {command}", ""]
if block == "plan":
    lines += [row("scene", "side of `--interleave auto`", "texels", "MB beside the scene"), "|---|---|---|---|"]
    for path in sorted(work.glob("plan.*")):
        found = [re.search(pattern, path.read_text(), re.M).group(1)
                 for pattern in (r"^interleave +(\d+)", r"^views +(.*?), (?:conservative|depth maps|answered)", r"^memory +([\d.]+)")]
        lines.append(row(path.name[5:], *found))
elif block == "stress":
    report = json.loads((work / "stress.json").read_text())
    rows = report["rows"]
    lines += [f"{len(rows) - report['failed']} of {len(rows)} cases are right.", "",
              row("case", "what is right", "what was seen", "verdict"), "|---|---|---|---|"]
    lines += [row(r["name"], r["right"], r["seen"], "right" if r["passed"] else "wrong") for r in rows]
elif block == "twins":
    lines += [row("scene", "visibility", "rel_mse against twin", "mean_bias"), "|---|---|---|---|"]
    for path in sorted(work.glob("twins.*")):
        _, scene, visibility = path.name.split(".")
        r = json.loads(path.read_text())
        lines.append(row(scene, visibility, f"{r['rel_mse']:.2g}", f"{100 * r['mean_bias']:+.5f} %"))
elif block == "moving":
    lines += [row("estimator, visibility", "ms to pose and rebuild", "ms of an iteration", "ms of a frame", "MB on the device"), "|---|---|---|---|---|"]
    for folder in sorted((work / "moving").iterdir()):
        # The first frame compiles the shaders.
        frames = [json.loads(path.read_text()) for path in sorted(folder.iterdir())[1:]]
        middle = lambda value: statistics.median(map(value, frames))
        rebuild, iteration = (1e3 * middle(lambda f: f["seconds"][part]) for part in ("setup", "render"))
        megabytes = 1e-6 * middle(lambda f: f["bytes"] + f["scene_bytes"])
        lines.append(row(folder.name, f"{rebuild:.0f}", f"{iteration:.0f}", f"{rebuild + iteration:.0f}", f"{megabytes:.0f}"))
elif block == "tests":
    lines += ["```text", (work / "tests").read_text().rstrip(), "```"]
else:
    text = (work / "bench" / "report.md").read_text()
    lines += re.sub(r"^## ", "#### ", text[text.index("\n## ") + 1:], flags=re.M).rstrip().splitlines()
    if block == "study":
        # The page compares errors; times per pass and names of devices would bury them.
        lines = [line for line in lines if not re.match(r"- .*: lightsheaf ", line)]
        lines = re.sub(r"Device time in .*?(?=\n#### |\Z)", "", "\n".join(lines), flags=re.S).rstrip().splitlines()
    curve = re.search(r"<svg.*?</svg>", (work / "bench" / "report.html").read_text(), re.S)
    if block == "methods" and curve:
        pathlib.Path("assets/error-time.svg").write_text(curve.group(0) + "\n")
textured = os.environ.get("TEXTURED")
if textured:
    lines = [line.replace(textured, pathlib.Path(textured).name) for line in lines]
begin, end = f"<!-- made by scripts/results.sh: {block} -->", "<!-- end -->"
old = page.read_text()
start = old.index(begin) + len(begin)
page.write_text(old[:start] + "\n" + "\n".join(lines) + "\n" + old[old.index(end, start):])
print(f"{page}: {block}")
PYTHON
done
