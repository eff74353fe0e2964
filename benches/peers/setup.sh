#!/usr/bin/env bash
# Installs programs of others for `lightsheaf bench --peer`: benches/peers/setup.sh [mitsuba] [luxcore] [cycles] [--into DIR]
#
# Each into a virtual environment of its own under DIR (target/peers unless given; 0.3, 0.5 and 1 GB), from the package index that
# pip is set to. Needs Python 3.9 or later with venv; Blender's package wants one certain version, which its error names.
set -euo pipefail

say() { printf 'peers: %s\n' "$*" >&2; }
fail() { printf 'error: %s\n' "$*" >&2; exit 2; }

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
into=$here/../../target/peers
peers=()
while [[ $# -gt 0 ]]; do
    case $1 in
        mitsuba | luxcore | cycles) peers+=("$1") ;;
        --into) [[ $# -gt 1 ]] || fail "--into needs a folder"; into=$2; shift ;;
        *) fail "$1: there are mitsuba, luxcore, cycles and --into DIR" ;;
    esac
    shift
done
[[ ${#peers[@]} -gt 0 ]] || peers=(mitsuba luxcore cycles)
python=${PYTHON:-python3}
command -v "$python" >/dev/null || fail "$python is not there: install Python 3, or name one in PYTHON"
mkdir -p "$into"
into=$(cd "$into" && pwd)

# Versions that these scripts were written against.
package() {
    case $1 in
        mitsuba) echo "mitsuba==3.9.1" ;;
        luxcore) echo "pyluxcore==2.11.2" ;;
        cycles) echo "bpy>=4.2,<6" ;;
    esac
}

failed=()
for peer in "${peers[@]}"; do
    say "$peer: installing $(package "$peer") into $into/$peer"
    if [[ ! -x $into/$peer/bin/python ]]; then
        "$python" -m venv "$into/$peer" || fail "no virtual environment: install Python's venv module (on Debian: apt-get install python3-venv)"
    fi
    if ! "$into/$peer/bin/python" -m pip install --quiet --disable-pip-version-check "$(package "$peer")" "numpy<3"; then
        say "$peer cannot be installed here; pip says above why (often no package for this version of Python: name another in PYTHON)"
        failed+=("$peer")
        continue
    fi
    say "ready: --peer '$peer=$into/$peer/bin/python $here/peer_$peer.py'"
done
[[ ${#failed[@]} -eq 0 ]] || exit 1
