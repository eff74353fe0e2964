#!/usr/bin/env bash
# Measures what `lightsheaf denoise` gains at equal time of rendering, against the references of the shared folder: a table for
# docs/results.md. Needs scripts/setup.sh --denoise and a build. SECONDS_EACH and SEEDS choose the time of a render and the seeds.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
seconds=${SECONDS_EACH:-8} seeds=${SEEDS:-1 2 3} program=target/debug/lightsheaf
folder=$(mktemp -d)
# shellcheck disable=SC2064
trap "rm -rf '$folder'" EXIT

error() { "$program" compare "$1" "$2" --json | sed -n 's/.*"rel_mse": *\([^,]*\),*/\1/p'; }
median() { sort -g | awk '{ all[NR] = $1 } END { printf "%.2g", all[int((NR + 1) / 2)] }'; }

echo "| scene | method | samples | rel_mse | denoised | seconds of denoising |"
echo "|---|---|---|---|---|---|"
for scene in cornell_point cornell_glossy; do
    for method in "shared --interleave 1" "shared --interleave 4" "shared --interleave 4 --unfiltered" "path"; do
        : >"$folder/before"; : >"$folder/after"; : >"$folder/samples"; : >"$folder/seconds"
        for seed in $seeds; do
            # shellcheck disable=SC2086
            "$program" render "builtin:$scene" --method $method --budget "$seconds" --seed "$seed" --aov albedo,normal --stats "$folder/stats.json" -q -o "$folder/a.exr"
            began=$(date +%s.%N)
            "$program" denoise "$folder/a.exr" -o "$folder/b.exr"
            echo "$began $(date +%s.%N)" | awk '{ print $2 - $1 }' >>"$folder/seconds"
            error "$folder/a.exr" "../shared/references/${scene}_d4.exr" >>"$folder/before"
            error "$folder/b.exr" "../shared/references/${scene}_d4.exr" >>"$folder/after"
            sed -n 's/^  "samples": *\([0-9]*\),*/\1/p' "$folder/stats.json" >>"$folder/samples"
        done
        echo "| $scene | \`$method\` | $(median <"$folder/samples") | $(median <"$folder/before") | $(median <"$folder/after") | $(median <"$folder/seconds") |"
    done
done
