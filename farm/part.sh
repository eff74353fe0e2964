#!/usr/bin/env bash
# Renders part PART of PARTS of a picture of SAMPLES samples to FOLDER/part_PART.exr, unless that file is there: a part that was
# rendered before is not rendered again. Farms run it once per part, on any machines; farm/merge.sh joins the parts.
#
#   farm/part.sh SCENE FOLDER SAMPLES PARTS PART [options of lightsheaf render]
#
# LIGHTSHEAF names the program, if it is not in PATH.
set -euo pipefail
[[ $# -ge 5 ]] || { sed -n '2,8s/^# \{0,1\}//p' "$0" >&2; exit 2; }
scene=$1 folder=$2 samples=$3 parts=$4 part=$5
shift 5
for number in "$samples" "$parts" "$part"; do
    [[ $number =~ ^[1-9][0-9]*$ ]] || { echo "error: $number: SAMPLES, PARTS and PART are whole numbers from 1 on" >&2; exit 2; }
done
((part <= parts && parts <= samples)) || { echo "error: part $part of $parts parts of $samples samples: PART is at most PARTS, and PARTS at most SAMPLES" >&2; exit 2; }
out=$(printf '%s/part_%04d.exr' "$folder" "$part")
[[ -e $out ]] && { echo "$out: is there" >&2; exit 0; }
mkdir -p "$folder"
exec "${LIGHTSHEAF:-lightsheaf}" render "$scene" -o "$out" --sample-range "$(((part - 1) * samples / parts + 1))..$((part * samples / parts))" "$@"
