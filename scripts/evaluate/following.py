"""The commands `tracking`, `memory`, `cluster` and `web`: sequences, a camera for months, a cluster, a browser.

Each runs a script that others run, too, and gives its numbers.
"""

import json
import os
import re
import subprocess
import sys

import tables
from detectors import check_command
from places import ROOT

# Options of scripts/test-camera-memory: frames, viewers, learners, models, preset.
RUNS = (("10000", "1", "0", "1", "compact"), ("600", "50", "4", "40", "compact"), ("600", "50", "4", "40", "large"))


def tracking(args, folder):
    """Searches and tracks the rendered sequences of tests/examples/tracking.rs, and prints their table."""
    done = subprocess.run([os.path.join(ROOT, "scripts", "track-eval"), "--json"], stdout=subprocess.PIPE)
    if done.returncode:
        sys.exit("scripts/track-eval failed: see above")
    numbers = json.loads(done.stdout)
    print("\n".join(tables.sequences([numbers])))
    return numbers


def memory(args, folder):
    """The largest resident sizes of `keygraph camera` in the runs of scripts/test-camera-memory, kB."""
    check_command(args.keygraph)
    runs = []
    for options in RUNS:
        frames, viewers, learners, models = map(int, options[:4])
        run = [os.path.join(ROOT, "scripts", "test-camera-memory"), *options]
        environment = {**os.environ, "KEYGRAPH": os.path.abspath(args.keygraph)}
        done = subprocess.run(run, env=environment, stdout=subprocess.PIPE, text=True)
        print(done.stdout, end="", flush=True)
        if done.returncode:
            sys.exit(f"scripts/test-camera-memory {' '.join(options)} failed: see above")
        told = {"frames": frames, "viewers": viewers, "learners": learners, "models": models, "preset": options[4]}
        runs.append({**told, **sizes(done.stdout)})
    return {"runs": runs}


def cluster(args, folder):
    """Frames a second of examples/cluster on this machine."""
    done = subprocess.run(
        [os.path.join(ROOT, "scripts", "test-cluster"), "--measure"], stdout=subprocess.PIPE, text=True
    )
    if done.returncode or not done.stdout:
        sys.exit("scripts/test-cluster --measure failed: see above")
    numbers = {**json.loads(done.stdout.splitlines()[-1]), "processors": os.cpu_count()}
    print("\n".join(tables.cluster(numbers)))
    return numbers


def web(args, folder):
    """Times of the browser package in headless Chromium."""
    done = subprocess.run([os.path.join(ROOT, "scripts", "test-web"), "--measure"], stdout=subprocess.PIPE, text=True)
    if done.returncode or not done.stdout:
        sys.exit("scripts/test-web --measure failed: see above")
    numbers = json.loads(done.stdout.splitlines()[-1])
    print("\n".join(f"{name}: {value:.3g}" for name, value in numbers.items()))
    return numbers


def sizes(printed):
    """The resident sizes and the peak that scripts/test-camera-memory printed, kB."""
    resident = [int(kb) for kb in re.findall(r"^ *\d+ +(\d+) +\d+$", printed, re.MULTILINE)]
    peak = re.search(r"^peak +(\d+) kB", printed, re.MULTILINE)
    if peak is None:
        sys.exit("scripts/test-camera-memory printed no peak")
    return {"resident_kb": resident, "peak_kb": int(peak[1])}
