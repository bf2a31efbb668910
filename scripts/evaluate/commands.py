"""The commands that measure how much is found, and how precisely."""

import statistics
import sys

from detectors import PRESETS, Keygraph, Refused, try_search
from figures import check_figure, draw_curves, draw_economy, numbers_of, save
from frames import CONDITIONS, SWEEPS, Renderer, Studio, build_renderer
from opencv import Rival
from pictures import read_pictures
from progress import Progress
from scoring import Verdict, corner_error, is_found, judge, mean_shift

# Bytes that `economy` caps models at.
SIZES = [32 << 10, 64 << 10, 128 << 10, 256 << 10, 512 << 10, 1 << 20, 2_000_000, 6_000_000]


def open_studio(args, folder):
    """A studio with the backgrounds and the seed of the command line."""
    backgrounds = read_pictures(args.backgrounds, 3, "backgrounds")
    return Studio(folder, backgrounds, args.seed, Renderer([build_renderer()]))


def detectors_of(args, folder):
    """The detectors that are compared: three variants of ours, and OpenCV's."""
    variants = [("Keygraph large", []), ("Keygraph standard", ["--preset", "standard"]), ("Keygraph luma", ["--luma"])]
    ours = [Keygraph(label, args.keygraph, folder, train) for label, train in variants]
    return [*ours, Rival("SIFT"), Rival("ORB")]


# ------------------------------------------------------------------ curves


def curves(args, folder):
    """One factor after the other, for every detector."""
    if args.redraw:
        numbers = numbers_of(args.out)
        return save(draw_curves(numbers), numbers, args.out)
    check_figure(args.out)
    objects = read_pictures(args.objects, 1, "objects")
    detectors = detectors_of(args, folder)
    times = {d.label: [] for d in detectors}
    progress = Progress(sum(len(s.values) for s in SWEEPS) * len(objects) * args.frames, "frames")
    with open_studio(args, folder) as studio:
        found = {s.factor: sweep_factor(studio, s, objects, detectors, args.frames, times, progress) for s in SWEEPS}
    shown = len(objects) * args.frames
    numbers = {
        "objects": len(objects),
        "frames": args.frames,
        "seed": args.seed,
        "values": {s.factor: s.values for s in SWEEPS},
        "found": {f: {label: [n / shown for n in line] for label, line in lines.items()} for f, lines in found.items()},
        "time_ms": {label: round(median_time(ms), 1) for label, ms in times.items()},
    }
    return save(draw_curves(numbers), numbers, args.out, args.keygraph)


def sweep_factor(studio, sweep, objects, detectors, frames, times, progress):
    """For each detector the frames found at each value of one factor; adds to `times`."""
    found = {d.label: [0] * len(sweep.values) for d in detectors}
    for picture in objects:
        keys = [(i, n) for i in range(len(sweep.values)) for n in range(frames)]
        shot = [studio.shoot(picture, {sweep.factor: sweep.values[i]}, sweep.factor, i, n) for i, n in keys]
        for detector in detectors:
            searches = try_search(detector, picture, shot)
            for (i, _), (frame, search) in zip(keys, searches, strict=True):
                found[detector.label][i] += is_found(search.detections, frame.quads[picture.digest])
                times[detector.label].append(search.ms)
        studio.clear(shot)
        progress.add(len(shot))
    return found


def median_time(times):
    """The median of the times, without those of refused pictures, which are not a number."""
    known = [ms for ms in times if ms == ms]
    return statistics.median(known) if known else 0.0


# ------------------------------------------------------------------ economy


def economy(args, folder):
    """Models capped at one size after the other, over a mix of conditions."""
    if args.redraw:
        numbers = numbers_of(args.out)
        return save(draw_economy(numbers), numbers, args.out)
    check_figure(args.out)
    objects = read_pictures(args.objects, 1, "objects")
    lines = sized_detectors(args, folder)
    found = {label: [dict.fromkeys(CONDITIONS, 0) for _ in detectors] for label, detectors in lines.items()}
    progress = Progress(len(objects) * len(CONDITIONS) * args.frames, "frames")
    with open_studio(args, folder) as studio:
        for picture in objects:
            for condition, factors in CONDITIONS.items():
                shot = [studio.shoot(picture, factors, condition, n) for n in range(args.frames)]
                for label, detectors in lines.items():
                    for i, detector in enumerate(detectors):
                        for frame, search in try_search(detector, picture, shot):
                            right = is_found(search.detections, frame.quads[picture.digest])
                            found[label][i][condition] += right
                studio.clear(shot)
                progress.add(len(shot))
    numbers = {"objects": len(objects), "frames": args.frames, "seed": args.seed}
    shown = len(objects) * args.frames
    numbers["found"] = {label: line_of(lines[label], found[label], objects, shown) for label in lines}
    return save(draw_economy(numbers), numbers, args.out, args.keygraph)


def sized_detectors(args, folder):
    """For each line of the figure its detectors, smallest first."""
    lines = {"Keygraph": [], "Keygraph luma": [], "SIFT": [Rival("SIFT")], "ORB": [Rival("ORB")]}
    for cap in SIZES:
        # Each size is trained with the preset that is made for it.
        preset = next((name for name, most in PRESETS if cap <= most), "large")
        train = ["--preset", preset, "--bytes", str(cap)]
        lines["Keygraph"].append(Keygraph(f"both {cap}", args.keygraph, folder, train, threads=2))
        lines["Keygraph luma"].append(Keygraph(f"luma {cap}", args.keygraph, folder, [*train, "--luma"], threads=2))
    return lines


def line_of(detectors, found, objects, shown):
    """The points of one line: bytes, the share found of all frames, and of each condition's."""
    sizes = [median_size(d, objects) for d in detectors]
    # A cap under which nothing can be trained, or which caps nothing any more, gives no point.
    kept = [i for i, size in enumerate(sizes) if size is not None and size not in sizes[:i]]
    points = {
        "bytes": [sizes[i] for i in kept],
        "all": [sum(found[i].values()) / (len(CONDITIONS) * shown) for i in kept],
    }
    for condition in CONDITIONS:
        points[condition] = [found[i][condition] / shown for i in kept]
    return points


def median_size(detector, objects):
    """The bytes of the median model; None when every object is refused."""
    sizes = []
    for picture in objects:
        try:
            sizes.append(detector.size(picture))
        except Refused as e:
            print(f"{picture.name}: {e}", file=sys.stderr)
    return float(statistics.median(sizes)) if sizes else None


# ------------------------------------------------------------------ precision


def precision(args, folder):
    """Corner errors in px where nothing makes it hard."""
    objects = read_pictures(args.objects, 1, "objects")
    detectors = detectors_of(args, folder)
    outlines = {d.label: [] for d in detectors}  # (verdict, error, shift) of each that is right
    progress = Progress(len(objects) * args.frames, "frames")
    with open_studio(args, folder) as studio:
        for picture in objects:
            shot = [studio.shoot(picture, {"scale": args.scale}, "precision", n) for n in range(args.frames)]
            for detector in detectors:
                for frame, search in try_search(detector, picture, shot):
                    truth = frame.quads[picture.digest]
                    for best, verdict in zip(search.detections[:1], judge(search.detections[:1], truth), strict=True):
                        if verdict.right:
                            error, shift = corner_error(best.corners, truth), mean_shift(best.corners, truth)
                            outlines[detector.label].append((verdict, error, shift))
            studio.clear(shot)
            progress.add(len(shot))
    return {"scale": args.scale, "frames": len(objects) * args.frames} | print_precision(
        outlines, args.scale, len(objects) * args.frames
    )


def print_precision(outlines, scale, shown):
    """Prints the table of errors, a line for each detector; gives its numbers."""
    numbers = {}
    print(
        f"| scale {scale:g} | found of {shown} | tight | median, px | 90th percentile, px | mean shift x, y, px |\n"
        "| --- | --- | --- | --- | --- | --- |"
    )
    for label, right in outlines.items():
        if not right:
            print(f"| {label} | 0 | 0 | | | |")
            continue
        errors = [error for _, error, _ in right]
        tight = sum(verdict is Verdict.TIGHT for verdict, _, _ in right)
        x, y = (statistics.fmean(shift[i] for _, _, shift in right) for i in (0, 1))
        most = statistics.quantiles(errors, n=10, method="inclusive")[-1] if len(errors) > 1 else errors[0]
        median = statistics.median(errors)
        print(f"| {label} | {len(right)} | {tight} | {median:.3f} | {most:.3f} | {x:+.3f}, {y:+.3f} |")
        numbers[label] = {"found": len(right), "tight": tight, "median_px": median, "p90_px": most}
    return numbers
