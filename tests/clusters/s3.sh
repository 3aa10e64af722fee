#!/usr/bin/env bash
# A study whose folder is in an object store: two shards at once, one killed and begun anew in an empty folder, as on another machine; a second
# process on a shard that is running is told. Afterwards every case is there and the table has the bytes of a local run. The store is moto, a server
# that speaks S3, from PyPI.
#
#   cargo build --release --features s3
#   tests/clusters/s3.sh [PITCHLINE [PYTHON]]
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
pitchline=$(realpath "${1:-$here/../../target/release/pitchline}")
work=$(mktemp -d)
python=${2:-$work/venv/bin/python}
server=
stop() {
  [ -z "$server" ] || kill "$server" 2>/dev/null || true
  rm -rf "$work"
}
trap stop EXIT
[ -x "$python" ] || { python3 -m venv "$work/venv" && "$python" -m pip install -q 'moto[server]'; }
"$(dirname "$python")/moto_server" -p 5599 >"$work/moto.log" 2>&1 &
server=$!
export AWS_ACCESS_KEY_ID=test AWS_SECRET_ACCESS_KEY=test AWS_REGION=us-east-1 AWS_ENDPOINT_URL=http://127.0.0.1:5599 AWS_ALLOW_HTTP=true
cd "$work"
for _ in $(seq 30); do
  "$python" -c "import boto3; boto3.client('s3', endpoint_url='$AWS_ENDPOINT_URL', region_name='us-east-1').create_bucket(Bucket='studies')" 2>/dev/null &&
    break || sleep 1
done
cp "$here/study.toml" s.toml
"$pitchline" study s.toml -o local >/dev/null
to=s3://studies/trial
"$pitchline" study s.toml -o $to --shard 1/2 --threads 1 --scratch one &
first=$!
"$pitchline" study s.toml -o $to --shard 2/2 --threads 1 --scratch two --budget 3s || echo "shard 2 ended with $?"
echo "lost: the folder of shard 2"
rm -rf two
"$pitchline" study s.toml -o $to --shard 2/2 --threads 1 --scratch other
wait $first
"$pitchline" study s.toml -o $to --collect --scratch all >/dev/null
cmp local/results.parquet all/results.parquet
[ "$(cat all/*.rows | wc -l)" -eq 160 ]
"$python" - <<PY
import boto3
s3 = boto3.client("s3", endpoint_url="$AWS_ENDPOINT_URL", region_name="us-east-1")
own = s3.get_object(Bucket="studies", Key="trial/results.parquet")["Body"].read()
assert own == open("local/results.parquet", "rb").read()
print(sorted(o["Key"] for o in s3.list_objects_v2(Bucket="studies")["Contents"]))
PY
echo "all cases are there, none ran twice, and the tables are the same"
