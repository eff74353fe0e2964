#!/usr/bin/env bash
# Builds the page in which Lightsheaf runs in a browser, and serves it to this machine.
#
#   scripts/web.sh [--port PORT]   the page is at http://localhost:8080/ until Ctrl-C
#   scripts/web.sh --build         only builds it, into target/page: any host that serves files can serve this folder
#
# The browser needs WebGPU; rays come from rasterization, since no page has ray queries.
set -euo pipefail

fail() { printf 'error: %s\n' "$*" >&2; exit 2; }

port=8080 serve=1
while [[ $# -gt 0 ]]; do
    case $1 in
        --port) [[ ${2:-} =~ ^[0-9]+$ ]] || fail "--port needs a number"; port=$2; shift 2 ;;
        --build) serve=""; shift ;;
        -h | --help) sed -n '2,/^set/{/^set/!s/^# \{0,1\}//p}' "${BASH_SOURCE[0]}"; exit ;;
        *) fail "$1 is no option: there are --port PORT, --build and --help" ;;
    esac
done

cd "$(dirname "${BASH_SOURCE[0]}")/.."
PATH=$PATH:$HOME/.cargo/bin
command -v cargo >/dev/null || fail "cargo is not there: install Rust from https://rustup.rs"
target=wasm32-unknown-unknown
if ! [[ -d $(rustc --print sysroot)/lib/rustlib/$target ]]; then
    # The exit status 3 tells those who can do without the page, as tests can.
    lacks() { printf 'error: %s\n' "$*" >&2; exit 3; }
    command -v rustup >/dev/null || lacks "Rust's standard library for $target is not there: install it beside cargo"
    echo "setup: installing Rust's standard library for $target (the page is compiled with it)" >&2
    rustup target add "$target" || lacks "rustup cannot install $target: see its messages above"
fi

output=${CARGO_TARGET_DIR:-target}
cargo build --locked --package lightsheaf-web --profile web --target "$target"
cargo build --locked --package lightsheaf-web-tool
mkdir -p "$output/page"
"$output/debug/lightsheaf-web-tool" bind "$output/$target/web/lightsheaf_web.wasm" "$output/page"
cp web/index.html web/page.js "$output/page/"
bytes=$(gzip -9 -c "$output/page/lightsheaf_web_bg.wasm" | wc -c)
printf 'The page is in %s: %d.%d MB, compressed by gzip\n' "$output/page" $(((bytes + 50000) / 1000000)) $(((bytes + 50000) / 100000 % 10)) >&2
[[ -z $serve ]] || exec "$output/debug/lightsheaf-web-tool" serve "$output/page" "$port"
