"""Runs the shards of a pitchline study on a Ray cluster.

    pip install ray
    pitchline study STUDY.toml -o FOLDER --engine ray --shards 8

pitchline writes the tasks to FOLDER/ray.json and starts this script; by hand it is `python pitchline_ray.py FOLDER/ray.json`. Each task is the
command of one shard. Program, study file and folder must have the same paths on all nodes. A task whose worker or node is lost is begun again by
Ray and goes on from its journal, so that no case is run twice.
"""

import ctypes
import json
import signal
import subprocess
import sys

try:
    import ray
except ImportError:
    sys.exit("error: this Python has no ray\nhelp: pip install ray, or --python names another Python")


def end_with_parent():
    """The child is ended when its worker dies: otherwise it would hold the shard, and the task that Ray begins again could not go on."""
    if sys.platform == "linux":
        PR_SET_PDEATHSIG = 1
        ctypes.CDLL("libc.so.6").prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def run_shard(command):
    done = subprocess.run(command, capture_output=True, text=True, preexec_fn=end_with_parent)
    if done.returncode != 0:
        # 2 is bad input: another try ends alike.
        wrong = ValueError if done.returncode == 2 else RuntimeError
        raise wrong(f"{' '.join(command)} ended with {done.returncode}: {done.stderr[-2000:]}")
    return done.stdout


def main():
    with open(sys.argv[1], encoding="utf-8") as file:
        job = json.load(file)
    ray.init(address=job["address"], log_to_driver=False)
    # A retry is begun for a lost worker and for a command that fails, such as one that finds its shard still held.
    task = ray.remote(num_cpus=job["threads"], max_retries=job["retries"], retry_exceptions=[RuntimeError])(run_shard)
    names = {task.remote(command): command for command in job["commands"]}
    waiting, failed = list(names), 0
    while waiting:
        (done, *_), waiting = ray.wait(waiting, num_returns=1)
        try:
            print(*ray.get(done).splitlines()[:1], flush=True)
        except Exception as error:  # the other shards go on
            failed += 1
            print(f"shard failed: {error}", file=sys.stderr, flush=True)
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
