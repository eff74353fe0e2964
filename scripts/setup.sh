#!/usr/bin/env bash
# Installs what Lightsheaf needs and this machine lacks; says what and why. Touches nothing where nothing is missing.
#
#   a C++ compiler     Rust links with it, and the FLIP metric is C++
#   a Vulkan loader    finds the drivers (not needed on macOS, which has Metal)
#   a Vulkan device    a GPU's driver; where there is none, Mesa's software driver, which renders on the CPU
#
# With --denoise only Intel Open Image Denoise, for `render --denoise`, from the Python package pyoidn (Apache 2.0), into the user's
# data folder; Debian and Ubuntu have no package of it. Needs python3 with pip, on Linux on x86-64.
#
# With --window also what `lightsheaf view` needs (the libraries of X11), with --tests also a display that nobody sees, hands and
# eyes (Xvfb, xdotool, xwd), by which the tests use its window, and on Debian a browser, in which they run the page and whose
# Vulkan is a second software driver. Where no browser can be installed, what needs it is skipped.
#
# Knows Debian 12 (Mesa from backports, whose version has ray queries), Debian 13 and Ubuntu 24.04 or later. Elsewhere it
# says what to install. With --check it only says what is missing, and fails if anything is.
set -euo pipefail

say() { printf 'setup: %s\n' "$*" >&2; }
fail() { printf 'error: %s\n' "$*" >&2; exit 2; }

# --- What is there -----------------------------------------------------------------------------------------------------

libraries=""
known_library() { # by absolute path, or by a name that the dynamic linker finds
    if [[ $1 == */* ]]; then [[ -e $1 ]]; else [[ $libraries == *"$1 ("* ]]; fi
}

# A driver counts when its manifest's library is there and so is a device node that it can drive. Software drivers need none.
has_device() {
    local manifests manifest text library
    shopt -s nullglob
    if [[ -n ${VK_DRIVER_FILES:-${VK_ICD_FILENAMES:-}} ]]; then
        IFS=: read -ra manifests <<<"${VK_DRIVER_FILES:-${VK_ICD_FILENAMES:-}}"
    else
        manifests=("${XDG_CONFIG_HOME:-$HOME/.config}"/vulkan/icd.d/*.json "${XDG_DATA_HOME:-$HOME/.local/share}"/vulkan/icd.d/*.json
            /etc/xdg/vulkan/icd.d/*.json /etc/vulkan/icd.d/*.json /usr/local/{etc,share}/vulkan/icd.d/*.json /usr/share/vulkan/icd.d/*.json)
    fi
    local nvidia=(/dev/nvidia[0-9]*) render=(/dev/dri/renderD* /dev/dx[g])
    for manifest in ${manifests[@]+"${manifests[@]}"}; do
        [[ -r $manifest ]] || continue
        text=$(<"$manifest")
        [[ $text =~ \"library_path\"[[:space:]]*:[[:space:]]*\"([^\"]+)\" ]] || continue
        library=${BASH_REMATCH[1]}
        [[ $library == ./* || $library == ../* ]] && library=$(dirname "$manifest")/$library
        known_library "$library" || continue
        case $library in
            *lvp* | *swiftshader*) return 0 ;;
            *nvidia*) [[ ${#nvidia[@]} -gt 0 ]] && return 0 ;;
            *) [[ ${#render[@]} -gt 0 ]] && return 0 ;;
        esac
    done
    return 1
}

# --- The denoiser ------------------------------------------------------------------------------------------------------

install_denoiser() {
    local data=${XDG_DATA_HOME:-$HOME/.local/share}/lightsheaf/oidn/lib temporary file
    if [[ -e $data/libOpenImageDenoise.so.2 ]]; then return; fi
    [[ $check ]] && { say "missing: Intel Open Image Denoise (render --denoise)"; exit 1; }
    [[ $(uname -sm) == "Linux x86_64" ]] || fail "--denoise knows Linux on x86-64 only: install Open Image Denoise 2, and name its library by LIGHTSHEAF_OIDN"
    python3 -m pip --version >/dev/null 2>&1 || fail "--denoise needs python3 with pip: install them (apt-get install python3-pip)"
    temporary=$(mktemp -d)
    # shellcheck disable=SC2064
    trap "rm -rf '$temporary'" EXIT
    say "installing Intel Open Image Denoise into $data (85 MB are downloaded)"
    python3 -m pip -q --disable-pip-version-check download --no-deps pyoidn==2.5.1.0 -d "$temporary" >&2 || fail "pyoidn 2.5.1.0 cannot be downloaded: see the messages above"
    python3 -m zipfile -e "$temporary"/pyoidn-*.whl "$temporary"
    mkdir -p "$data"
    for file in libOpenImageDenoise_core.so.2.5.1 libOpenImageDenoise_device_cpu.so.2.5.1 libtbb.so.12 libOpenImageDenoise.so.2; do
        cp "$temporary/pyoidn/oidn/lib/$file" "$data/$file"
    done
    say "done"
}

window="" tests="" check="" denoise=""
for option in "$@"; do
    case $option in
        --window) window=yes ;;
        --tests) window=yes tests=yes ;;
        --check) check=yes ;;
        --denoise) denoise=yes ;;
        *) fail "unknown option $option: there are --window, --tests, --denoise and --check" ;;
    esac
done
if [[ $denoise ]]; then
    install_denoiser
    exit 0
fi

missing=()
look() {
    missing=()
    command -v c++ >/dev/null && command -v cc >/dev/null || missing+=(compiler)
    [[ $(uname) == Darwin ]] && return 0
    libraries=$(PATH=$PATH:/sbin:/usr/sbin ldconfig -p 2>/dev/null || true)
    known_library libvulkan.so.1 || missing+=(loader)
    has_device || missing+=(driver)
    local library tool
    if [[ $window ]]; then
        for library in libX11.so.6 libXcursor.so.1 libXi.so.6 libxkbcommon-x11.so.0; do
            known_library $library || { missing+=(x11) && break; }
        done
    fi
    if [[ $tests ]]; then
        for tool in Xvfb xdotool xwd; do
            command -v $tool >/dev/null || { missing+=(display) && break; }
        done
    fi
}

# Debian's package has the browser and SwiftShader, its software Vulkan. Ubuntu's is only a door to another store.
install_browser() {
    command -v chromium >/dev/null && return
    [[ $(. /etc/os-release 2>/dev/null && echo "${ID:-}") == debian ]] || { say "no Chromium, and no package of it: tests in a browser are skipped"; return; }
    [[ $check ]] && { say "missing: Chromium (tests in a browser are skipped without it)"; return; }
    local as_root=()
    [[ $(id -u) -eq 0 ]] || as_root=(sudo -n)
    say "installing Chromium (the tests run the page in it)"
    local apt=(${as_root[@]+"${as_root[@]}"} env DEBIAN_FRONTEND=noninteractive apt-get -qq -o DPkg::Lock::Timeout=120)
    { "${apt[@]}" update && "${apt[@]}" install -y --no-install-recommends chromium; } >&2 </dev/null ||
        say "Chromium cannot be installed: tests in a browser are skipped"
}

reason() {
    case $1 in
        compiler) echo "a C++ compiler (Rust links with it, and the FLIP metric is C++)" ;;
        loader) echo "the Vulkan loader libvulkan.so.1 (finds graphics drivers)" ;;
        driver) echo "a Vulkan device (none was found; Mesa's software driver renders on the CPU)" ;;
        x11) echo "libraries of X11 (the viewer's window)" ;;
        display) echo "Xvfb, xdotool and xwd (a display, hands and eyes for the tests of the viewer)" ;;
    esac
}

# --- What is missing ---------------------------------------------------------------------------------------------------

[[ $tests ]] && install_browser
look
[[ ${#missing[@]} -eq 0 ]] && exit 0
for thing in "${missing[@]}"; do say "missing: $(reason "$thing")"; done
[[ $check ]] && exit 1

ID="" VERSION_ID="" VERSION_CODENAME=""
# shellcheck disable=SC1091
[[ -r /etc/os-release ]] && . /etc/os-release
case $ID:${VERSION_ID:-99} in
    debian:12) backports=yes ;;
    debian:1[3-9] | debian:99 | ubuntu:24.04 | ubuntu:24.10 | ubuntu:2[5-9].*) backports="" ;;
    *) fail "this system (${PRETTY_NAME:-$(uname)}) is not one that this script knows (Debian 12 and 13, Ubuntu 24.04); install what is missing and start again" ;;
esac

as_root=()
if [[ $(id -u) -ne 0 ]]; then
    command -v sudo >/dev/null || fail "installing packages needs root: install sudo, or run scripts/setup.sh as root once"
    as_root=(sudo)
    [[ -t 0 ]] || as_root+=(-n)
fi
apt() {
    say "running: ${as_root[*]+"${as_root[*]} "}apt-get $*"
    ${as_root[@]+"${as_root[@]}"} env DEBIAN_FRONTEND=noninteractive apt-get -qq -o DPkg::Lock::Timeout=120 "$@" >&2 </dev/null ||
        fail "apt-get $1 failed: see its messages above"
}

packages=() from_backports=()
for thing in "${missing[@]}"; do
    case $thing in
        compiler) packages+=(g++) ;;
        loader) packages+=(libvulkan1) ;;
        x11) packages+=(libx11-6 libxcursor1 libxi6 libxkbcommon-x11-0) ;;
        display) packages+=(xvfb xdotool x11-apps) ;;
        driver) if [[ $backports ]]; then from_backports+=(mesa-vulkan-drivers); else packages+=(mesa-vulkan-drivers); fi ;;
    esac
done

if [[ ${#from_backports[@]} -gt 0 ]] && ! grep -rqsE '^[^#]*bookworm-backports' /etc/apt/sources.list /etc/apt/sources.list.d/; then
    # The mirror that the machine uses already.
    mirror=$(apt-get indextargets --format '$(RELEASE) $(REPO_URI)' 'Created-By: Packages' 2>/dev/null |
        sed -n 's/^bookworm \(.*[^/]\)\/*$/\1/p' | head -n 1) || mirror=""
    [[ $mirror ]] || fail "apt knows no mirror of Debian 12 (bookworm): add one with bookworm-backports to apt's sources, or install a Vulkan driver"
    list=/etc/apt/sources.list.d/lightsheaf-backports.list
    say "adding $list: Debian 12's own Mesa (22.3) has no ray queries, the one in backports has"
    key=/usr/share/keyrings/debian-archive-keyring.gpg
    signed=""
    [[ -e $key ]] && signed="[signed-by=$key] "
    echo "deb ${signed}$mirror bookworm-backports main" |
        ${as_root[@]+"${as_root[@]}"} tee "$list" >/dev/null
fi

say "installing: ${packages[*]+"${packages[*]} "}${from_backports[*]+"${from_backports[*]}"}"
apt update
[[ ${#packages[@]} -eq 0 ]] || apt install -y --no-install-recommends "${packages[@]}"
[[ ${#from_backports[@]} -eq 0 ]] || apt install -y --no-install-recommends -t bookworm-backports "${from_backports[@]}"

look
[[ ${#missing[@]} -eq 0 ]] || fail "still missing after installing: $(reason "${missing[0]}")"
say "done"
