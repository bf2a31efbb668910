"""Searches an archive of pictures and videos on a cluster of Ray.

    python search.py -m cover.kgm --out rows/ PICTURES/ clip.mp4        on all processors of this machine
    python search.py -m cover.kgm --out rows/ --address auto PICTURES/  on the cluster that it is part of

Leaves Parquet files in --out, which all machines must see (and the inputs too). A worker that is lost is
started again and searches its chunk anew; a run that is started again searches what is missing. No row is
lost and none is there twice.

Needs: pip install "ray[data]" pyarrow and the package keygraph; opencv-python-headless for videos.
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

    def __init__(self, model, options, out):
        self.model, self.options, self.out = ray.get(model[0]), options, out
        self.detector = chunks.detector_of(self.model, options)

    def __call__(self, batch):
        """Searches the chunks of a batch."""
        counts = []
        for chunk in batch["chunk"]:
            chunk = [str(source) for source in chunk]
            path = chunks.file_of(self.out, chunk, self.model, self.options)
            counts.append(chunks.search(self.detector, chunk, path))
        return {"rows": counts}


def main():
    """Runs the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-m", "--model", action="append", required=True, metavar="FILE.kgm")
    parser.add_argument("--out", required=True, metavar="DIR", help="folder of the Parquet files")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), metavar="N", help="detectors at once")
    parser.add_argument("--address", metavar="ADDRESS", help="a cluster of Ray; without it, one on this machine")
    parser.add_argument("--profile", default="vga")
    parser.add_argument("--threshold", type=float, default=0.8)
    parser.add_argument("inputs", nargs="+", metavar="INPUT", help="pictures, videos, folders of them")
    args = parser.parse_args()

    options = {"profile": args.profile, "threshold": args.threshold}
    try:
        model = keygraph.pack(args.model).bytes()
        all_chunks = chunks.chunks(args.inputs)
    except (OSError, ValueError) as error:
        sys.exit(f"search.py: {error}")
    os.makedirs(args.out, exist_ok=True)
    out = os.path.abspath(args.out)
    missing = [chunk for chunk in all_chunks if not os.path.exists(chunks.file_of(out, chunk, model, options))]
    print(f"{len(all_chunks)} chunks, {len(all_chunks) - len(missing)} of them done before", file=sys.stderr)
    if not missing:
        return

    here = {"num_cpus": args.workers, "include_dashboard": False} if args.address is None else {}
    ray.init(address=args.address, log_to_driver=False, logging_level="warning", **here)
    ray.data.DataContext.get_current().enable_progress_bars = False
    # In a list, since Ray would put a reference's value in its place.
    stored = [ray.put(model)]
    start = time.perf_counter()
    found = ray.data.from_items([{"chunk": chunk} for chunk in missing], override_num_blocks=len(missing)).map_batches(
        Searcher,
        fn_constructor_args=(stored, options, out),
        batch_size=1,
        compute=ray.data.ActorPoolStrategy(size=min(args.workers, len(missing))),
        num_cpus=1,
    )
    rows = sum(part["rows"] for part in found.iter_rows())
    seconds = time.perf_counter() - start
    print(f"{rows} frames in {seconds:.1f} s, {rows / seconds:.0f} a second", file=sys.stderr)


if __name__ == "__main__":
    main()
