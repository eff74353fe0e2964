#!/usr/bin/env bash
# Builds the Python package into an environment of its own below target/python, and runs its tests and the examples of
# docs/python.md. The exit status 3 says that Python, or what it needs from its package index, is not there.
set -euo pipefail

lacks() { printf 'error: %s\n' "$*" >&2; exit 3; }

cd "$(dirname "${BASH_SOURCE[0]}")/.."
PATH=$PATH:$HOME/.cargo/bin
output=${CARGO_TARGET_DIR:-target}/python
python3 -c 'import sys; sys.exit(sys.version_info < (3, 9))' 2>/dev/null || lacks "python3 of version 3.9 or later is not there"
if ! [[ -x $output/venv/bin/maturin ]]; then
    rm -rf "$output/venv"
    python3 -m venv "$output/venv" >&2 || lacks "python3 cannot make environments: install its modules venv and pip"
    "$output/venv/bin/python" -m pip install --quiet --disable-pip-version-check 'maturin>=1.9,<2' 'numpy>=1.21' ||
        lacks "pip cannot install maturin and NumPy: see its messages above"
fi
export VIRTUAL_ENV=$PWD/$output/venv
[[ $output == /* ]] && VIRTUAL_ENV=$output/venv
# What cargo has built for the library's tests is used again.
"$VIRTUAL_ENV/bin/maturin" develop --quiet --features as-tested --manifest-path python/Cargo.toml
exec "$VIRTUAL_ENV/bin/python" -m unittest discover --start-directory python/tests --verbose
