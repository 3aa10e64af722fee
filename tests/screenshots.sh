#!/usr/bin/env bash
# Pictures of a short run of every bundled drive in the Rerun viewer: the native one under Xvfb, and the one for web browsers,
# served by `pitchline view --web`, in Chromium. To be looked at: links, contacts, forces, plots and table should be there.
#   tests/screenshots.sh FOLDER
# Needs: Xvfb, a Vulkan driver (mesa-vulkan-drivers), rerun-sdk==0.36.3 (PITCHLINE_RERUN names its program), chromium.
set -euo pipefail
out=$(mkdir -p "${1:?give a folder for the pictures}" && cd "$1" && pwd)
cd "$(dirname "$0")/.."
pitchline=${CARGO_TARGET_DIR:-target}/release/pitchline
rerun=${PITCHLINE_RERUN:-rerun}
export RERUN_ANALYTICS=0
Xvfb :97 -screen 0 1600x1000x24 >/dev/null 2>&1 & xvfb=$!
trap 'kill $xvfb 2>/dev/null || true' EXIT
sleep 1
for drive in bush-20-40 silent-20-40 smartchain-20-40; do
  "$pitchline" run "$drive" --duration 4ms --every 20us --picture-every 20us -o "$out/$drive.rrd"
  # This version of the viewer saves the picture and then ends with an error.
  DISPLAY=:97 timeout 120 "$rerun" "$out/$drive.rrd" --bind 127.0.0.1 --port auto \
    --screenshot-to "$out/$drive-native.png" --window-size 1500x950 --renderer vulkan >/dev/null 2>&1 || true
  "$pitchline" view --web --port 9797 "$out/$drive.rrd" >"$out/view.log" 2>&1 & view=$!
  for _ in $(seq 50); do grep -q http "$out/view.log" && break; sleep 0.1; done
  address=$(grep -o 'http://[^ ]*' "$out/view.log" | head -1)
  # Chromium may take its picture before the viewer is there; what it has compiled by then it keeps for the next try.
  for _ in $(seq 8); do
    timeout 180 chromium --headless=new --no-sandbox --use-angle=swiftshader --enable-unsafe-swiftshader \
      --ignore-gpu-blocklist --user-data-dir="$out/chromium" --window-size=1500,950 --virtual-time-budget=200000 \
      --screenshot="$out/$drive-web.png" "$address" >/dev/null 2>&1 || true
    [ "$(stat -c %s "$out/$drive-web.png")" -gt 60000 ] && break
  done
  kill -INT $view; wait $view || true
  for picture in "$out/$drive-native.png" "$out/$drive-web.png"; do
    # A page that is still loading makes a small one.
    [ "$(stat -c %s "$picture")" -gt 60000 ] && echo "$picture" || { echo "no picture: $picture" >&2; exit 1; }
  done
done
rm -rf "$out/chromium"
