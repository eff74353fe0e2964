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

# The page can be done without where its target cannot be installed; tests that need it are skipped then.
build_page() {
    scripts/web.sh --build || { [[ $? -eq 3 ]]; return; }
    cargo clippy --locked --package lightsheaf-web --target wasm32-unknown-unknown -- -D warnings
}

# Runs one of the jobs below, and prints what it says when it has ended.
run_job() {
    local job=$1 began=$SECONDS log status=0
    log=$(mktemp)
    # Many tests compile variants of shaders for pictures of few pixels each. For them software Vulkan leaves out LLVM's
    # optimizations: with a cold cache, the time of the mixes in tests/paths is 0.6 of what it is otherwise, that of tests/guard.rs
    # 0.7, that of a dozen tests each of raster and paths the same in sum, but that of tests/raster_statistics.rs, which renders
    # much with few shaders, at least 1.46.
    [[ $job == raster_statistics ]] || export GALLIVM_PERF=nopt
    case $job in
        units) cargo test --locked --lib --bins ;;
        second_driver) second_driver ;;
        *) cargo test --locked --test="$job" ;;
    esac >"$log" 2>&1 </dev/null || status=$?
    printf '\n-- %s took %d s\n%s\n' "$job" $((SECONDS - began)) "$(<"$log")"
    rm "$log"
    # A failure ends neither the other jobs nor the list of what failed.
    [[ $status -eq 0 ]] || { printf '%s\n' "$job" >>"$failed"; }
}

# Pictures, shader functions and poses on a second driver, without ray queries and with other rounding: SwiftShader, which comes
# with Debian's browser. Tests of ray queries skip there.
second_driver() {
    local driver=/usr/lib/chromium/vk_swiftshader_icd.json
    [[ -r $driver ]] || { echo "skipped: $driver is not there"; return; }
    REQUIRE_GPU=0 VK_DRIVER_FILES=$driver cargo test --locked --test raster --test animation -- analytic devices golden silhouettes twins pose
}

# Two jobs at a time, the longest first: a process's tests share a device, which compiles shaders for one of them at a time, so that
# most jobs keep one core busy. None fails where it is slow. That of the Python package is early, since cargo lets no other job start
# while it compiles. The window's tests measure how long input waits, and have the machine for themselves.
all_tests() {
    local long=(raster python paths raster_statistics reference second_driver layers shaders checkpoint browser)
    local alone=viewer others
    mapfile -t others < <(cd tests && printf '%s\n' *.rs */main.rs | sed 's|/main\.rs$||; s|\.rs$||' | grep -vxF "${long[@]/#/-e}" -e "$alone")
    failed=$(mktemp)
    export failed
    export -f run_job second_driver
    printf '%s\n' "${long[@]}" "${others[@]}" units | xargs -P 2 -I {} bash -c 'set -euo pipefail; run_job {}'
    (run_job "$alone")
    [[ ! -s $failed ]] || { printf '\nerror: failed: %s\n' "$(paste -sd ' ' "$failed")" >&2; return 1; }
    rm "$failed"
}

step cargo fmt --all --check
step cargo clippy --locked --workspace --all-targets -- -D warnings
step build_page
# The tests are built first, so that the time of each step tells compiler and tests apart.
step cargo test --locked --no-run
step all_tests
step cargo test --locked --doc
RUSTDOCFLAGS="-D warnings" step cargo doc --locked --no-deps
printf '\nAll passed in %d s.\n' "$SECONDS"
