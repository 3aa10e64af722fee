#!/usr/bin/env bash
# A study on a real Ray: a cluster of this machine with two workers, one of them killed. Afterwards every case is there, none ran twice, and the
# table has the bytes of a local run. Installs ray into a temporary folder unless a Python that has it is named, and stops what it started.
#
#   tests/clusters/ray.sh [PITCHLINE [PYTHON]]
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
pitchline=$(realpath "${1:-$here/../../target/release/pitchline}")
work=$(mktemp -d)
python=${2:-$work/venv/bin/python}
stop() {
  "$(dirname "$python")/ray" stop --force >/dev/null 2>&1 || true
  rm -rf "$work"
}
trap stop EXIT
[ -x "$python" ] || { python3 -m venv "$work/venv" && "$python" -m pip install -q ray; }
export RAY_USAGE_STATS_ENABLED=0
"$(dirname "$python")/ray" start --head --num-cpus=2 --include-dashboard=false --disable-usage-stats >/dev/null
cd "$work"
cp "$here/study.toml" s.toml
"$pitchline" study s.toml -o local >/dev/null
done_cases() { "$pitchline" study s.toml -o cluster --status --json 2>/dev/null | python3 -c 'import json, sys; print(json.load(sys.stdin)["done"])' 2>/dev/null || echo 0; }
"$pitchline" study s.toml -o cluster --engine ray --shards 4 --python "$python" >told.txt 2>log.txt &
study=$!
while [ "$(done_cases)" -lt 20 ]; do sleep 0.5; done
worker=$(pgrep -f "ray::run_shard" | head -1)
echo "killing worker $worker at $(done_cases) cases"
kill -9 "$worker"
wait $study
cat log.txt
echo "at the end: $(done_cases) of 160 cases"
[ "$(done_cases)" -eq 160 ]
cmp local/results.parquet cluster/results.parquet
[ "$(cat cluster/*.rows | wc -l)" -eq 160 ]
echo "all cases are there, none ran twice, and the tables are the same"
