#!/usr/bin/env bash
# Measures what `lightsheaf denoise` gains at equal time of rendering: a table for docs/results.md.
#
#   scripts/denoise.sh [SCENE=REFERENCE.exr ...]     # default: two boxes, against the references of the shared folder
#
# Pictures have the size of their reference. Needs scripts/setup.sh --denoise and a build. SECONDS_EACH and SEEDS choose the time of a
# render and the seeds.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
seconds=${SECONDS_EACH:-10} seeds=${SEEDS:-1 2 3} program=target/debug/lightsheaf
folder=$(mktemp -d)
# shellcheck disable=SC2064
trap "rm -rf '$folder'" EXIT

error() { "$program" compare "$1" "$2" --json | sed -n 's/.*"rel_mse": *\([^,]*\),*/\1/p'; }
median() { sort -g | awk '{ all[NR] = $1 } END { printf "%.2g", all[int((NR + 1) / 2)] }'; }

[[ $# -gt 0 ]] || set -- builtin:cornell_{point=../shared/references/cornell_point,glossy=../shared/references/cornell_glossy}_d4.exr
echo "| scene | method | samples | rel_mse | denoised | seconds of denoising |"
echo "|---|---|---|---|---|---|"
for pair in "$@"; do
    scene=${pair%%=*} reference=${pair#*=}
    size=$("$program" compare "$reference" "$reference" --json | sed -n 's/.*"\(width\|height\)": *\([0-9]*\),/\2/p' | paste -sd x)
    for method in "shared --interleave 1" "shared --interleave 4" "shared --interleave 4 --unfiltered" "path"; do
        : >"$folder/before"; : >"$folder/after"; : >"$folder/samples"; : >"$folder/seconds"
        for seed in $seeds; do
            # shellcheck disable=SC2086
            "$program" render "$scene" --size "$size" --method $method --budget "$seconds" --seed "$seed" --aov albedo,normal --stats "$folder/stats.json" -q -o "$folder/a.exr"
            began=$(date +%s.%N)
            "$program" denoise "$folder/a.exr" -o "$folder/b.exr"
            echo "$began $(date +%s.%N)" | awk '{ print $2 - $1 }' >>"$folder/seconds"
            error "$folder/a.exr" "$reference" >>"$folder/before"
            error "$folder/b.exr" "$reference" >>"$folder/after"
            sed -n 's/^  "samples": *\([0-9]*\),*/\1/p' "$folder/stats.json" >>"$folder/samples"
        done
        name=$(basename "$scene")
        echo "| ${name#builtin:} | \`$method\` | $(median <"$folder/samples") | $(median <"$folder/before") | $(median <"$folder/after") | $(median <"$folder/seconds") |"
    done
done
