#!/usr/bin/env bash
# Renders every scene below a folder, small, each beside the reference, as one page: scripts/gallery.sh FOLDER [OUT] [options of render]
#
# Without options each picture is rendered as `lightsheaf render FILE` does, but for its size, 256x256 unless --size says
# otherwise. On a machine without a GPU, `--budget 20` keeps it short. A picture's camera, light and exposure are also those of its
# reference. OUT (default: target/gallery) gets index.html, the pictures as .png and .exr, and what each run said; what is there
# already is kept, so a page that was interrupted goes on. REFERENCE sets the options of the reference (default: --budget 20).
set -euo pipefail

fail() { echo "error: $*" >&2; exit 2; }
[[ $# -ge 1 && -d $1 ]] || fail "a folder with scenes is needed: scripts/gallery.sh FOLDER [OUT] [options of render]"
folder=$(cd "$1" && pwd)
shift
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
out=$root/target/gallery
if [[ $# -gt 0 && $1 != -* ]]; then
    out=$1
    shift
fi
mkdir -p "$out"
out=$(cd "$out" && pwd)
read -ra judged <<<"${REFERENCE:---budget 20}"
size=(--size 256x256)
own=()
for option in "$@"; do
    case $option in
        --size | --size=*) size=() ;;
    esac
done
case " $* " in
    *" --camera "*) own=(--camera "$(sed 's/.* --camera \([^ ]*\) .*/\1/' <<<" $* ")") ;;
esac

PATH=$PATH:$HOME/.cargo/bin
"$root/scripts/setup.sh"
(cd "$root" && cargo build --locked --bin lightsheaf)
lightsheaf=${CARGO_TARGET_DIR:-$root/target}/debug/lightsheaf

escape() { sed 's/&/\&amp;/g; s/</\&lt;/g; s/>/\&gt;/g'; }
field() { sed -n "s/^ *\"$1\": \(.*[^,]\),\{0,1\}$/\1/p" "$2" 2>/dev/null | head -n 1; }

page=$out/index.html
cat >"$page.part" <<HTML
<!doctype html><meta charset="utf-8"><title>Gallery</title>
<style>body{font:14px sans-serif;background:#222;color:#ddd}td{vertical-align:top;padding:4px}pre{white-space:pre-wrap;max-width:60em}
img{display:block}th{text-align:left}</style>
<table><tr><th>picture<th>reference<th>what was said
HTML
count=0
while IFS= read -r -d '' scene; do
    name=${scene#"$folder"/}
    stem=$(tr -c 'A-Za-z0-9\n' '_' <<<"${name%.*}")
    picture=$out/$stem
    # A Mitsuba file that is included by another, or settings of some program, is no scene.
    [[ $scene != *.xml ]] || grep -q '<scene' "$scene" || continue
    count=$((count + 1))
    echo "$name" >&2
    if [[ ! -e $picture.log ]]; then
        if "$lightsheaf" render "$scene" ${size[@]+"${size[@]}"} "$@" -o "$picture.png" -o "$picture.exr" \
            --stats "$picture.json" >"$picture.part" 2>&1; then
            exposure=$(field exposure_stops "$picture.json")
            # As large as the picture, which may be what the scene's camera asks for.
            columns=$(sed -n '/"size": \[/{n;s/[^0-9]//gp}' "$picture.json" | head -n 1)
            rows=$(sed -n '/"size": \[/{n;n;s/[^0-9]//gp}' "$picture.json" | head -n 1)
            "$lightsheaf" render "$scene" ${own[@]+"${own[@]}"} --size "${columns}x$rows" --method reference "${judged[@]}" \
                --exposure "$exposure" -o "$picture.reference.png" -o "$picture.reference.exr" --quiet >>"$picture.part" 2>&1 || true
            "$lightsheaf" compare "$picture.exr" "$picture.reference.exr" >>"$picture.part" 2>&1 || true
        fi
        mv "$picture.part" "$picture.log"
    fi
    {
        echo "<tr><td><img src=\"$stem.png\" alt=\"\"><td><img src=\"$stem.reference.png\" alt=\"\">"
        echo "<td><b>$(escape <<<"$name")</b><pre>$(sed "s|$out/||g; s|$folder/||g" "$picture.log" | escape)</pre>"
    } >>"$page.part"
done < <(find "$folder" \( -name '*.gltf' -o -name '*.glb' -o -name '*.xml' \) -print0 | sort -z)
[[ $count -gt 0 ]] || fail "there is no .gltf, .glb or .xml below $folder"
echo "</table>" >>"$page.part"
mv "$page.part" "$page"
echo "The page is $page ($count scenes)"
