#!/usr/bin/env bash
# Checks everything that has to hold: formatting, lints, tests, documentation. CI runs the same script.
#
# REQUIRE_GPU=1 makes tests fail that would be skipped without a Vulkan device.
# REQUIRE_SHARED=1 makes tests fail that would be skipped without the scenes and reference images in ../shared.
# REQUIRE_BROWSER=1 makes tests fail that would be skipped without a browser, or without the page that it shows.
# REQUIRE_PYTHON=1 makes the test of the Python package fail where it would be skipped without Python or its package index.
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

# Pictures, shader functions and poses on a second driver, without ray queries and with other rounding: SwiftShader, which comes
# with Debian's browser. Tests of ray queries skip there.
second_driver() {
    local driver=/usr/lib/chromium/vk_swiftshader_icd.json
    [[ -r $driver ]] || { echo "skipped: $driver is not there"; return; }
    REQUIRE_GPU=0 VK_DRIVER_FILES=$driver cargo test --locked --test raster --test animation -- analytic devices golden silhouettes twins pose
}

# The page can be done without where its target cannot be installed; tests that need it are skipped then.
build_page() {
    scripts/web.sh --build || { [[ $? -eq 3 ]]; return; }
    cargo clippy --locked --package lightsheaf-web --target wasm32-unknown-unknown -- -D warnings
}

step cargo fmt --all --check
step cargo clippy --locked --workspace --all-targets -- -D warnings
step build_page
# The tests are built first, so that the time of each step tells compiler and tests apart.
step cargo test --locked --no-run
# Most tests compile many variants of shaders for pictures of few pixels each: for them software Vulkan leaves out LLVM's
# optimizations. With a cold cache, the time of the mixes in tests/paths is 0.6 of what it is otherwise, that of tests/guard.rs 0.7,
# but that of tests/raster_statistics.rs, which renders much with few shaders, at least 1.46.
# A process's tests share a device, which compiles shaders for one of them at a time, so that tests/paths alone keeps three quarters
# of two cores busy, and tests/raster half: they run beside each other. None of these tests looks at a clock.
beside=(animation blending guard raster shaders skip tessellation views visibility webgpu)
mapfile -t others < <(cd tests && printf '%s\n' *.rs */main.rs | sed 's|/main\.rs$||; s|\.rs$||' | grep -vxF -e paths -e raster_statistics "${beside[@]/#/-e}")
two_at_a_time() {
    local log status=0
    log=$(mktemp)
    cargo test --locked "${beside[@]/#/--test=}" >"$log" 2>&1 &
    cargo test --locked --test=paths || status=$?
    wait $! || status=$?
    cat "$log"
    rm "$log"
    return "$status"
}
export GALLIVM_PERF=nopt
step cargo test --locked --lib --bins "${others[@]/#/--test=}"
step two_at_a_time
unset GALLIVM_PERF
step cargo test --locked --test=raster_statistics
step cargo test --locked --doc
step second_driver
RUSTDOCFLAGS="-D warnings" step cargo doc --locked --no-deps
printf '\nAll passed in %d s.\n' "$SECONDS"
