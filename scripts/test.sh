#!/usr/bin/env bash
# Checks everything that has to hold: formatting, lints, tests, documentation. CI runs the same script.
#
# REQUIRE_GPU=1 makes tests fail that would be skipped without a Vulkan device.
# REQUIRE_SHARED=1 makes tests fail that would be skipped without the scenes and reference images in ../shared.
set -euo pipefail

cd "$(dirname "${BASH_SOURCE[0]}")/.."
PATH=$PATH:$HOME/.cargo/bin
scripts/setup.sh --tests
command -v cargo >/dev/null || { echo "error: cargo is not there: install Rust from https://rustup.rs" >&2; exit 2; }
for component in rustfmt clippy; do
    command -v "cargo-${component/rustfmt/fmt}" >/dev/null && "cargo-${component/rustfmt/fmt}" --version >/dev/null 2>&1 && continue
    command -v rustup >/dev/null || { echo "error: $component is not there: install it beside cargo" >&2; exit 2; }
    echo "setup: installing the Rust component $component (the checks run it)" >&2
    rustup component add "$component"
done

step() {
    printf '\n== %s\n' "$*"
    local began=$SECONDS
    "$@" </dev/null
    printf '== took %d s\n' $((SECONDS - began))
}

step cargo fmt --all --check
step cargo clippy --locked --all-targets -- -D warnings
# The tests are built first, so that the time of each step tells compiler and tests apart.
step cargo test --locked --no-run
step cargo test --locked
RUSTDOCFLAGS="-D warnings" step cargo doc --locked --no-deps
printf '\nAll passed in %d s.\n' "$SECONDS"
