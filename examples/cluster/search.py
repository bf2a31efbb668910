"""Searches an archive of pictures and videos on a cluster of Ray.

    python search.py -m cover.kgm --out rows/ PICTURES/ clip.mp4        on all processors of this machine
    python search.py -m cover.kgm --out rows/ --address auto PICTURES/  on the cluster that it is part of

Leaves Parquet files in --out, which all machines must see under this path, and the inputs too. A worker that
is lost is started again and searches its chunk anew; a run that is started again searches what is missing. No
row is lost and none is there twice. A folder holds the rows of one run: with another model, other options or
other inputs, give another one.

Needs on each machine: pip install "ray[data]" pyarrow and the package keygraph; opencv-python-headless for
videos. Exit status: 0 well, 1 something could not be read (the rest was done), 2 wrong command line.
"""

import argparse
import os
import sys
import time

import chunks
import keygraph
import ray


class Searcher:
    """An actor: one detector. The model comes from the object store of its machine."""

    def __init__(self, model, options):
        self.detector = chunks.detector_of(ray.get(model[0]), options)

    def __call__(self, batch):
        """Searches the chunks of a batch."""
        counts, errors = [], []
        for chunk, path in zip(batch["chunk"], batch["path"], strict=True):
            try:
                counts.append(chunks.search(self.detector, [str(source) for source in chunk], str(path)))
                errors.append("")
            except OSError as error:
                counts.append(0)
                errors.append(str(error))
        return {"rows": counts, "error": errors}


def main():
    """Runs the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-m", "--model", action="append", required=True, metavar="FILE.kgm")
    parser.add_argument("--out", required=True, metavar="DIR", help="folder of the Parquet files")
    parser.add_argument(
        "--workers", type=int, metavar="N", help="detectors at once; one for each processor unless given"
    )
    parser.add_argument("--address", metavar="ADDRESS", help="a cluster of Ray; without it, one on this machine")
    parser.add_argument("--profile", default="vga")
    parser.add_argument("--threshold", type=float, default=0.8)
    parser.add_argument("inputs", nargs="+", metavar="INPUT", help="pictures, videos, folders of them")
    args = parser.parse_args()

    options = {"profile": args.profile, "threshold": args.threshold}
    out = os.path.abspath(args.out)
    try:
        model = keygraph.pack(args.model).bytes()
        work = {chunks.file_of(out, chunk, model, options): chunk for chunk in chunks.chunks(args.inputs)}
    except (OSError, ValueError) as error:
        sys.exit(f"search.py: {error}")
    os.makedirs(out, exist_ok=True)
    if strangers := chunks.strangers(out, work):
        sys.exit(
            f"search.py: {out} holds rows of another run ({strangers[0]}, ...): give another --out, or remove them"
        )
    missing = [{"path": path, "chunk": chunk} for path, chunk in work.items() if not os.path.exists(path)]
    print(f"{len(work)} chunks, {len(work) - len(missing)} of them done before", file=sys.stderr)
    if missing:
        sys.exit(search(args, model, options, missing))


def search(args, model, options, missing):
    """Searches the chunks that are missing; gives the exit status."""
    here = {"num_cpus": args.workers, "include_dashboard": False} if args.address is None else {}
    # Workers on other machines get the module `chunks` with it.
    code = {"working_dir": os.path.dirname(os.path.abspath(__file__))}
    ray.init(address=args.address, runtime_env=code, log_to_driver=False, logging_level="warning", **here)
    ray.data.DataContext.get_current().enable_progress_bars = False
    workers = args.workers or int(ray.cluster_resources()["CPU"])
    # In a list, since Ray would put a reference's value in its place.
    stored = [ray.put(model)]
    start = time.perf_counter()
    found = ray.data.from_items(missing, override_num_blocks=len(missing)).map_batches(
        Searcher,
        fn_constructor_args=(stored, options),
        batch_size=1,
        compute=ray.data.ActorPoolStrategy(size=min(workers, len(missing))),
        num_cpus=1,
    )
    parts = list(found.iter_rows())
    seconds, rows = time.perf_counter() - start, sum(part["rows"] for part in parts)
    print(f"{rows} frames in {seconds:.1f} s, {rows / seconds:.0f} a second", file=sys.stderr)
    errors = [part["error"] for part in parts if part["error"]]
    if errors:
        print(f"search.py: {len(errors)} chunks could not be read, run it again: {errors[0]}", file=sys.stderr)
    return int(bool(errors))


if __name__ == "__main__":
    main()
