#!/usr/bin/env bash
# Renders a picture on a Slurm cluster: an array of jobs, one per part, and a job that merges the parts when all are there. FOLDER
# and SCENE have to be visible on all nodes. Parts that are there are not rendered again, so run it again after failures.
#
#   farm/slurm.sh SCENE FOLDER OUT.exr SAMPLES PARTS [options of lightsheaf render]
#
# SBATCH_ARGS are further options of sbatch, such as "--partition=gpu --gres=gpu:1 --time=1:00:00".
set -euo pipefail
[[ $# -ge 5 ]] || { sed -n '2,7s/^# \{0,1\}//p' "$0" >&2; exit 2; }
command -v sbatch >/dev/null || { echo "error: sbatch is not there: run this on a Slurm cluster" >&2; exit 2; }
scene=$1 folder=$2 out=$3 samples=$4 parts=$5
shift 5
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
mkdir -p "$folder"
quoted=$(printf ' %q' "$@")
[[ $# -gt 0 ]] || quoted=""
# shellcheck disable=SC2086
array=$(sbatch --parsable --requeue --job-name=lightsheaf --array="1-$parts" --output="$folder/part_%a.log" ${SBATCH_ARGS:-} \
    --wrap "$(printf '%q ' "$here/part.sh" "$scene" "$folder" "$samples" "$parts")\$SLURM_ARRAY_TASK_ID$quoted")
merge=$(sbatch --parsable --job-name=lightsheaf-merge --dependency="afterok:${array%%;*}" --kill-on-invalid-dep=yes --output="$folder/merge.log" \
    --wrap "$(printf '%q ' "$here/merge.sh" "$folder" "$out" "$samples")")
echo "parts: job $array; merge: job $merge"
