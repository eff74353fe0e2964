#!/usr/bin/env bash
# Measures Lightsheaf on this machine's GPU and writes one report to send in: report.html, which holds report.json.
#
#   benches/gpu.sh [-o DIR] [--sponza FILE] [--small]
#
#   -o DIR          where to (default: target/gpu)
#   --sponza FILE   Sponza.gltf of Khronos' sample assets, rendered at 1920x1080 too
#   --small         an eighth of the size, few samples and triangles, one case of the stress: says whether the script works, and
#                   is no measurement
#   LIGHTSHEAF      the program (default: it is built with optimization)
#
# Takes about ten minutes on a GPU. Every picture is rendered twice and the second run counts, so that shaders are compiled.
set -euo pipefail

fail() { printf 'error: %s\n' "$*" >&2; exit 2; }

started=$PWD
cd "$(dirname "${BASH_SOURCE[0]}")/.."
folder=${CARGO_TARGET_DIR:-target}/gpu sponza="" small=""
while [[ $# -gt 0 ]]; do
    case $1 in
        -o) folder=$(cd "$started" && realpath -m "${2:?-o needs a folder}"); shift 2 ;;
        --sponza) sponza=$(cd "$started" && realpath "${2:?--sponza needs a file}"); shift 2 ;;
        --small) small=yes; shift ;;
        -h | --help) sed -n '2,/^set/{/^set/!s/^# \{0,1\}//p}' "benches/gpu.sh"; exit ;;
        *) fail "$1 is no option: there are -o DIR, --sponza FILE, --small and --help" ;;
    esac
done
lightsheaf=${LIGHTSHEAF:-}
if [[ ! $lightsheaf ]]; then
    scripts/setup.sh
    PATH=$PATH:$HOME/.cargo/bin
    cargo build --locked --release --bin lightsheaf
    lightsheaf=${CARGO_TARGET_DIR:-target}/release/lightsheaf
fi
[[ -x $lightsheaf ]] || fail "$lightsheaf is not there: leave LIGHTSHEAF out, and it is built"
mkdir -p "$folder"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# WIDTH HEIGHT SAMPLES, smaller on request.
sized() {
    if [[ $small ]]; then
        echo "--size $(($1 / 8))x$(($2 / 8)) --samples 2"
    else
        echo "--size $1x$2 --samples $3"
    fi
}

if [[ $small ]]; then cases="one pixel" of_paper=10000 many=10000; else cases="" of_paper=174000 many=1000000; fi

# The workload of Tokuyoshi and Ogaki 2012: 174,000 triangles, one light subpath and one direction for each pixel of a 4x4
# square in each sample, two bounces, their combination of strategies and their size of ray-bundles.
paper="builtin:displaced_room:$of_paper $(sized 1920 1088 32) --interleave 4 --bounces 2 --strategies paper --bundle-resolution 256"
cornell="builtin:cornell_point $(sized 512 512 256) --interleave 1"
runs=(
    "2012, exact: $paper --visibility exact"
    "2012, fast: $paper --visibility fast"
)
for options in "exact:" "fast: --visibility fast" "exact, interleaved 4: --interleave 4" "fast, interleaved 4: --visibility fast --interleave 4" \
    "path: --method path"; do
    [[ ! $sponza ]] || runs+=("Sponza, ${options%%:*}: SPONZA $(sized 1920 1080 32)${options#*:}")
done
runs+=(
    "cornell_point, lists: $cornell --visibility-from lists"
    "cornell_point, grid: $cornell --visibility-from grid"
    "cornell_point, fast: $cornell --visibility fast"
    "cornell_point, bdpt: builtin:cornell_point $(sized 512 512 64) --method bdpt"
    "cornell_point, path: builtin:cornell_point $(sized 512 512 64) --method path"
    "displaced_room, lists: builtin:displaced_room:$many $(sized 1024 1024 64) --visibility-from lists"
    "displaced_room, grid: builtin:displaced_room:$many $(sized 1024 1024 64) --visibility-from grid"
)

say() { printf 'gpu: %s\n' "$*" >&2; }
quoted() { sed 's/\\/\\\\/g; s/"/\\"/g; s/^/"/; s/$/"/'; }

# Writes the report of what has run so far, so that a run that is cut off leaves one.
report() {
    {
        printf '{\n"date": "%s",\n"commit": "%s",\n"system": %s,\n"small": %s,\n"stress": ' "$(date -u +%F)" \
            "$(git rev-parse --short HEAD 2>/dev/null || echo unknown)" "$(uname -srm | quoted)" "$([[ $small ]] && echo true || echo false)"
        cat "$work/stress.json"
        printf ',\n"renders": ['
        local separator=""
        for part in "$work"/render-*.json; do
            [[ -e $part ]] || continue
            printf '%s\n' "$separator"
            cat "$part"
            separator=","
        done
        printf '\n]}\n'
    } >"$work/report.json"
    {
        sed '/REPORT/,$d' benches/gpu.html
        # Nothing in the text may end the script that holds it.
        sed 's/</\\u003c/g' "$work/report.json"
        sed '1,/REPORT/d' benches/gpu.html
    } >"$work/report.html"
    mv "$work/report.json" "$work/report.html" "$folder"
}

say "a short stress: is every picture right?"
"$lightsheaf" stress --short --json ${cases:+"$cases"} >"$work/stress.json" || [[ $? -eq 1 ]] || fail "lightsheaf stress did not run: see its message above"
report
for index in "${!runs[@]}"; do
    name=${runs[index]%%: *} options=${runs[index]#*: }
    read -ra words <<<"$options"
    for i in "${!words[@]}"; do [[ ${words[i]} == SPONZA ]] && words[i]=$sponza; done
    say "$name: $options"
    failure=""
    for _ in cold warm; do
        "$lightsheaf" render "${words[@]}" -q -o "$work/picture.exr" --stats "$work/stats.json" 2>"$work/error" || { failure=$(tail -n 1 "$work/error"); break; }
    done
    {
        printf '{"name": %s, "options": %s, ' "$(quoted <<<"$name")" "$(quoted <<<"$options")"
        # A method that this device cannot run is a result, too.
        if [[ $failure ]]; then say "$failure"; printf '"error": %s}' "$(quoted <<<"$failure")"; else printf '"stats": '; sed 's|"scene": ".*/|"scene": "|' "$work/stats.json"; printf '}'; fi
    } >"$work/render-$(printf %02d "$index").json"
    report
done
say "$folder/report.html has it all; please send it in with the name of your GPU and its driver"
