#!/usr/bin/env bash
# Joins all parts that farm/part.sh rendered to FOLDER. Parts that are missing are an error.
#
#   farm/merge.sh FOLDER OUT.exr SAMPLES
#
# LIGHTSHEAF names the program, if it is not in PATH.
set -euo pipefail
[[ $# -eq 3 ]] || { sed -n '2,6s/^# \{0,1\}//p' "$0" >&2; exit 2; }
said=$("${LIGHTSHEAF:-lightsheaf}" merge "$1"/part_*.exr -o "$2" 2>&1) || { echo "$said" >&2; exit 2; }
echo "$said" >&2
# The last parts may be missing, which leaves no gap.
[[ $said == *" $3 samples of "* ]] || { echo "error: $2: has not $3 samples; render the missing parts and merge again" >&2; exit 2; }
