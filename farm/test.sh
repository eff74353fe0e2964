#!/usr/bin/env bash
# Renders a picture in eight parts on a real Slurm and by a real Open Job Description, and compares it with one run.
#
#   farm/test.sh [slurm] [openjd]        # both, if none is named
#
# Slurm runs on this machine alone, from a folder of its own, beside any other; a running task is killed and one is requeued. It is
# installed by apt-get if it is missing (slurm-wlm, munge), which needs root or sudo; the daemons need root. openjd-cli is installed
# into a folder of its own by pip. LIGHTSHEAF names the program, otherwise that of `cargo build`.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
say() { printf 'farm: %s\n' "$*" >&2; }
fail() { printf 'error: %s\n' "$*" >&2; exit 1; }
LIGHTSHEAF=${LIGHTSHEAF:-$here/../target/debug/lightsheaf}
export LIGHTSHEAF
[[ -x $LIGHTSHEAF ]] || fail "$LIGHTSHEAF is not there: run cargo build, or name the program by LIGHTSHEAF"

scene=builtin:cornell_area samples=1024 parts=8 options=(--size 128x128 --method reference)
work=$(mktemp -d)
daemons=()
cleanup() {
    for daemon in ${daemons[@]+"${daemons[@]}"}; do kill "$daemon" 2>/dev/null || true; done
    wait 2>/dev/null || true
    rm -rf "$work"
}
trap cleanup EXIT

same_as_one_run() { # OUT.exr
    local error
    [[ -e $work/whole.exr ]] || "$LIGHTSHEAF" render "$scene" -o "$work/whole.exr" --samples "$samples" "${options[@]}" -q
    error=$("$LIGHTSHEAF" compare "$1" "$work/whole.exr" --max-rel-mse 1e-10 --json) || fail "$1 is not the picture of one run: $error"
    say "the merged picture is that of one run: $(tr -d '\n ' <<<"$error")"
}

# --- Slurm ---------------------------------------------------------------------------------------------------------------

start_slurm() {
    command -v slurmctld slurmd munged sbatch >/dev/null || {
        command -v apt-get >/dev/null || fail "install Slurm and munge: this script knows apt-get only"
        say "installing slurm-wlm and munge"
        local sudo=()
        [[ $(id -u) -eq 0 ]] || sudo=(sudo)
        ${sudo[@]+"${sudo[@]}"} apt-get -qq update
        DEBIAN_FRONTEND=noninteractive ${sudo[@]+"${sudo[@]}"} apt-get -qq install -y --no-install-recommends slurm-wlm munge >/dev/null
    }
    [[ $(id -u) -eq 0 ]] || fail "slurmd runs tasks for other users and needs root: run this as root"
    local host etc=$work/slurm
    host=$(hostname -s)
    mkdir -m 755 -p "$etc"/{state,spool}
    chmod 755 "$work"
    (umask 077 && head -c 1024 /dev/urandom >"$etc/munge.key")
    munged --foreground --force --socket="$etc/munge.sock" --key-file="$etc/munge.key" --pid-file="$etc/munged.pid" \
        --seed-file="$etc/munged.seed" --log-file="$etc/munged.log" >/dev/null 2>&1 &
    daemons+=($!)
    cat >"$etc/slurm.conf" <<CONF
ClusterName=lightsheaf
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=36817
SlurmdPort=36818
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket=$etc/munge.sock
StateSaveLocation=$etc/state
SlurmdSpoolDir=$etc/spool
SlurmctldPidFile=$etc/slurmctld.pid
SlurmdPidFile=$etc/slurmd.pid
ProctrackType=proctrack/pgid
TaskPlugin=task/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
ReturnToService=2
SchedulerParameters=requeue_delay=1,sched_interval=2
NodeName=$host NodeAddr=127.0.0.1 CPUs=$(nproc) State=UNKNOWN
PartitionName=all Nodes=$host Default=YES MaxTime=INFINITE State=UP
CONF
    export SLURM_CONF=$etc/slurm.conf
    for _ in {1..50}; do [[ -S $etc/munge.sock ]] && break; sleep 0.1; done
    slurmctld -D >"$etc/slurmctld.log" 2>&1 &
    daemons+=($!)
    slurmd -D >"$etc/slurmd.log" 2>&1 &
    daemons+=($!)
    for _ in {1..100}; do
        [[ $(sinfo -h -o %T 2>/dev/null) == idle ]] && return
        sleep 0.3
    done
    tail -n 20 "$etc"/slurm*.log >&2
    fail "Slurm does not start"
}

submit() { # prints the numbers of the array and of the merge
    "$here/slurm.sh" "$scene" "$work/parts" "$work/slurm.exr" "$samples" "$parts" "${options[@]}" | grep -oE '[0-9]+'
}

wait_for() { # SECONDS COMMAND...
    local end=$((SECONDS + $1))
    shift
    until "$@"; do
        ((SECONDS < end)) || { squeue >&2; fail "after a long time still not: $*"; }
        sleep 0.2
    done
}

ended() { [[ -z $(squeue -h -j "$1" 2>/dev/null) ]]; }
state() { scontrol show job "$1" | grep -oE 'JobState=[A-Z]+'; }
renderer_of() { pgrep -f "^$LIGHTSHEAF render .* $work/parts/part_000$1.exr "; } # prints the process
renders() { renderer_of "$1" >/dev/null; }

test_slurm() {
    start_slurm
    say "$(sinfo --version) on $(nproc) cores: $parts parts"
    read -r -d '' array merge < <(submit | tr '\n' ' ') || true
    # Node failures and preemption requeue a task.
    wait_for 300 renders 2
    sleep 0.5
    scontrol requeue "${array}_2"
    say "task 2 was requeued while it rendered"
    # A program that is killed fails, and its part is missing.
    wait_for 300 renders 3
    sleep 0.5
    kill -KILL "$(renderer_of 3)"
    say "task 3 was killed while it rendered"
    wait_for 600 ended "$array"
    wait_for 60 ended "$merge"
    [[ ! -e $work/parts/part_0003.exr ]] || fail "the killed task left its part"
    [[ ! -e $work/slurm.exr ]] || fail "the merge ran without a part"
    [[ $(find "$work/parts" -name 'part_*.exr' | wc -l) -eq $((parts - 1)) ]] || fail "parts are missing: $(ls "$work/parts")"
    say "$((parts - 1)) parts are there; merge job: $(state "$merge")"
    touch -d '1 hour ago' "$work"/parts/part_*.exr
    read -r -d '' array merge < <(submit | tr '\n' ' ') || true
    wait_for 600 ended "$array"
    wait_for 60 ended "$merge"
    [[ $(find "$work/parts" -name 'part_*.exr' -mmin -30) == "$work/parts/part_0003.exr" ]] || fail "parts that were there were rendered again"
    say "the second submission rendered part 3 alone: $(<"$work/parts/merge.log")"
    same_as_one_run "$work/slurm.exr"
}

# --- Open Job Description ------------------------------------------------------------------------------------------------

test_openjd() {
    local openjd=$work/openjd step
    say "installing openjd-cli"
    python3 -m venv "$openjd"
    "$openjd/bin/pip" -q --disable-pip-version-check install openjd-cli
    for step in Render Merge; do
        "$openjd/bin/openjd" run "$here/openjd.yaml" --step "$step" -p Scene="$scene" -p Folder="$work/chunks" -p Output="$work/openjd.exr" \
            -p Tools="$here" -p Samples="$samples" -p Parts="$parts" -p PartsPerTask=3 -p Options="${options[*]}" >"$work/$step.log" 2>&1 ||
            { cat "$work/$step.log" >&2; fail "openjd run --step $step"; }
    done
    say "openjd-cli $("$openjd/bin/pip" list 2>/dev/null | awk '$1 == "openjd-cli" {print $2}'): tasks $(grep -oE 'Part\(CHUNK\[INT\]\) = [0-9-]+' "$work/Render.log" | sort -u | tr '\n' ';')"
    same_as_one_run "$work/openjd.exr"
}

[[ $# -gt 0 ]] || set -- slurm openjd
for one in "$@"; do
    case $one in
        slurm) test_slurm ;;
        openjd) test_openjd ;;
        *) sed -n '2,9s/^# \{0,1\}//p' "$0" >&2; exit 2 ;;
    esac
done
say "all is well"
