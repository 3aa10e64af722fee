#!/usr/bin/env bash
# A study on a real SLURM: one node with two slots on this machine, a task killed by scancel, the node drained half-way. Afterwards every case is
# there, none ran twice, and the table has the bytes of a local run. Installs slurm-wlm and munge (Debian, as root) unless they are there, keeps
# all else in a temporary folder, and stops what it started.
#
#   tests/clusters/slurm.sh [PITCHLINE]
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
pitchline=$(realpath "${1:-$here/../../target/release/pitchline}")
command -v sbatch slurmctld slurmd munged >/dev/null ||
  { apt-get update -qq && apt-get install -y -qq --no-install-recommends slurm-wlm munge >/dev/null; }
work=$(mktemp -d)
chmod 755 "$work"
export SLURM_CONF=$work/slurm.conf
stop() {
  for daemon in slurmd slurmctld munged; do
    [ -f "$work/$daemon.pid" ] && kill "$(cat "$work/$daemon.pid")" 2>/dev/null || true
  done
  sleep 1
  rm -rf "$work"
}
trap stop EXIT

mkdir "$work/state" "$work/spool"
dd if=/dev/urandom of="$work/munge.key" bs=1024 count=1 2>/dev/null
chmod 400 "$work/munge.key"
munged --force --key-file="$work/munge.key" --socket="$work/munge.sock" --pid-file="$work/munged.pid" \
  --log-file="$work/munged.log" --seed-file="$work/munge.seed"
node=$(hostname -s)
cat >"$SLURM_CONF" <<CONF
ClusterName=test
SlurmctldHost=$node(127.0.0.1)
AuthType=auth/munge
AuthInfo=socket=$work/munge.sock
CredType=cred/munge
SlurmUser=root
SlurmdUser=root
StateSaveLocation=$work/state
SlurmdSpoolDir=$work/spool
SlurmctldPidFile=$work/slurmctld.pid
SlurmdPidFile=$work/slurmd.pid
SlurmctldLogFile=$work/slurmctld.log
SlurmdLogFile=$work/slurmd.log
SlurmctldPort=26817
SlurmdPort=26818
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
ReturnToService=2
SchedulerParameters=sched_interval=2,bf_interval=2
KillWait=5
NodeName=$node NodeAddr=127.0.0.1 CPUs=2 State=UNKNOWN
PartitionName=all Nodes=$node Default=YES MaxTime=INFINITE State=UP OverSubscribe=NO
CONF
echo "CgroupAutomount=no" >"$work/cgroup.conf"
slurmctld
slurmd
for _ in $(seq 30); do sinfo -h -o %t 2>/dev/null | grep -q idle && break || sleep 1; done
sinfo

cd "$work"
cp "$here/study.toml" s.toml
"$pitchline" study s.toml -o local >/dev/null
done_cases() { "$pitchline" study s.toml -o cluster --status --json | python3 -c 'import json, sys; print(json.load(sys.stdin)["done"])'; }
wait_for_end() { while [ -n "$(squeue -h -o %i)" ]; do sleep 1; done; }

"$pitchline" study s.toml -o cluster --engine slurm --shards 4 | tee submitted.txt
job=$(sed -n 's/^submitted job \([0-9]*\):.*/\1/p' submitted.txt)
while [ "$(done_cases)" -lt 20 ]; do sleep 0.5; done
echo "killing task ${job}_1 at $(done_cases) cases"
scancel "${job}_1"
while [ "$(done_cases)" -lt 50 ]; do sleep 0.5; done
echo "draining the node at $(done_cases) cases, and cancelling what waits"
scontrol update nodename="$node" state=drain reason=test
squeue
scancel --state=PENDING "$job"
wait_for_end_of_running() { while [ -n "$(squeue -h -t RUNNING,COMPLETING -o %i)" ]; do sleep 1; done; }
wait_for_end_of_running
echo "after the drain: $(done_cases) of 160 cases"
[ "$(done_cases)" -lt 160 ]
scontrol update nodename="$node" state=resume
squeue -h -o %i | xargs -r scancel
"$pitchline" study s.toml -o cluster --resume --engine slurm --shards 4 >/dev/null
wait_for_end
echo "after --resume: $(done_cases) of 160 cases"
[ "$(done_cases)" -eq 160 ]
cmp local/results.parquet cluster/results.parquet
cmp local/results.csv cluster/results.csv
[ "$(cat cluster/*.rows | wc -l)" -eq 160 ]
echo "all cases are there, none ran twice, and the tables are the same"
