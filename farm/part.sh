#!/usr/bin/env bash
# Renders part PART of PARTS of a picture of SAMPLES samples to FOLDER/part_PART.exr, unless that file is there: a part that was
# rendered before is not rendered again. PART may be several, A-B. Farms run it for all parts, on any machines; farm/merge.sh joins
# the parts.
#
#   farm/part.sh SCENE FOLDER SAMPLES PARTS PART [options of lightsheaf render]
#
# LIGHTSHEAF names the program, if it is not in PATH. LIGHTSHEAF_OPTIONS are further options, separated by spaces.
set -euo pipefail
[[ $# -ge 5 ]] || { sed -n '2,9s/^# \{0,1\}//p' "$0" >&2; exit 2; }
scene=$1 folder=$2 samples=$3 parts=$4 part=$5
shift 5
first=${part%%-*} last=${part##*-}
for number in "$samples" "$parts" "$first" "$last"; do
    [[ $number =~ ^[1-9][0-9]*$ ]] || { echo "error: $number: SAMPLES, PARTS and PART are whole numbers from 1 on" >&2; exit 2; }
done
((first <= last && last <= parts && parts <= samples)) || { echo "error: part $part of $parts parts of $samples samples: PART is at most PARTS, and PARTS at most SAMPLES" >&2; exit 2; }
read -ra more <<<"${LIGHTSHEAF_OPTIONS:-}"
mkdir -p "$folder"
for ((part = first; part <= last; part++)); do
    out=$(printf '%s/part_%04d.exr' "$folder" "$part")
    if [[ -e $out ]]; then
        echo "$out: is there" >&2
        continue
    fi
    "${LIGHTSHEAF:-lightsheaf}" render "$scene" -o "$out" --sample-range "$(((part - 1) * samples / parts + 1))..$((part * samples / parts))" "$@" ${more[@]+"${more[@]}"}
done
