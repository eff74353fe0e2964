#!/usr/bin/env bash
# Renders a picture and says where it lies: scripts/render.sh [SCENE] [options of `lightsheaf render`]
set -euo pipefail

start=$PWD
cd "$(dirname "${BASH_SOURCE[0]}")/.."
root=$PWD
PATH=$PATH:$HOME/.cargo/bin
scripts/setup.sh
command -v cargo >/dev/null || { echo "error: cargo is not there: install Rust from https://rustup.rs" >&2; exit 2; }

scene=builtin:cornell_point
if [[ $# -gt 0 && $1 != -* ]]; then
    scene=$1
    shift
fi

picture=""
previous=""
for argument in "$@"; do
    case $previous:$argument in
        -o:* | --output:*) picture=$argument ;;
        *:--output=*) picture=${argument#--output=} ;;
        *:-o?*) picture=${argument#-o} ;;
    esac
    previous=$argument
done
if [[ -z $picture ]]; then
    picture=$root/target/picture.png
    set -- "$@" -o "$picture"
fi

# Without the window and its libraries, which a picture does not need. Paths on the command line start from where the caller stands.
cargo build --locked --bin lightsheaf --no-default-features --features cli
cd "$start"
"${CARGO_TARGET_DIR:-$root/target}/debug/lightsheaf" render "$scene" "$@"
case $picture in /*) ;; *) picture=$start/$picture ;; esac
# `--help` renders nothing.
[[ ! -e $picture ]] || echo "The picture is $picture"
