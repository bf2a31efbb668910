"""The figures of docs/, drawn from the numbers that lie beside them as JSON."""

import json
import math
import os
import sys

import matplotlib
from detectors import PRESETS
from frames import CONDITIONS, HEIGHT, SWEEPS, WIDTH
from record import build

matplotlib.use("Agg")
from matplotlib import pyplot as plt  # noqa: E402
from matplotlib.transforms import ScaledTranslation  # noqa: E402

# Okabe and Ito's colours, which the colour-blind can tell apart; line, marker and width as well.
STYLES = {
    "Keygraph large": dict(color="#0072B2", marker="o", linestyle="-", linewidth=2.4, zorder=5),
    "Keygraph standard": dict(color="#56B4E9", marker="s", linestyle="-", linewidth=1.6, zorder=4),
    "Keygraph luma": dict(color="#009E73", marker="^", linestyle="--", linewidth=1.6, zorder=3),
    "SIFT": dict(color="#D55E00", marker="D", linestyle="-", linewidth=1.6, zorder=2),
    "ORB": dict(color="#7A7A7A", marker="v", linestyle="-", linewidth=1.6, zorder=1),
}
INK, PALE = "#222222", "#DDDDDD"
BLUE, ORANGE = "#0072B2", "#D55E00"

plt.rcParams.update(
    {
        "font.family": "DejaVu Sans",
        "font.size": 11,
        "text.color": INK,
        "axes.labelcolor": INK,
        "axes.edgecolor": "#888888",
        "axes.linewidth": 0.8,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.titlesize": 12,
        "axes.titleweight": "bold",
        "axes.titlelocation": "left",
        "axes.titlepad": 8,
        "axes.grid": True,
        "axes.axisbelow": True,
        "grid.color": PALE,
        "grid.linewidth": 0.7,
        "xtick.color": INK,
        "ytick.color": INK,
        "xtick.major.size": 3,
        "ytick.major.size": 0,
        "xtick.minor.size": 0,
        "lines.markersize": 4.5,
        "lines.markeredgewidth": 0,
        "savefig.dpi": 150,
        "figure.facecolor": "white",
    }
)


def numbers_path(path):
    """The file of the numbers beside the figure at `path`."""
    return os.path.splitext(path)[0] + ".json"


def numbers_of(path):
    """The numbers that an earlier run left beside the figure at `path`."""
    try:
        with open(numbers_path(path), encoding="utf-8") as text:
            return json.load(text)
    except FileNotFoundError:
        sys.exit(f"{numbers_path(path)} is not there: run once without --redraw")


def check_figure(path):
    """Ends the program before the work when the figure could not be written after it."""
    folder = os.path.dirname(os.path.abspath(path))
    if not os.path.isdir(folder):
        sys.exit(f"cannot write {path}: the folder {folder} does not exist")


def save(figure, numbers, path, keygraph=None):
    """Writes the figure to `path` and the numbers beside it as JSON; gives the numbers.

    `keygraph` is the program that was measured; numbers that are drawn anew name theirs already.
    """
    figure.savefig(path)
    if keygraph is not None:
        numbers["build"] = build(keygraph)
    with open(numbers_path(path), "w", encoding="utf-8") as out:
        json.dump(numbers, out, indent=1)
        out.write("\n")
    print(f"wrote {path} and {os.path.basename(numbers_path(path))}", file=sys.stderr)
    return numbers


def per_cent(shares):
    """Shares as per cent."""
    return [100 * share for share in shares]


def per_cent_axis(axis):
    """An axis from 0 to 100 %."""
    axis.set_ylim(-3, 103)
    axis.set_yticks([0, 25, 50, 75, 100], ["0", "25", "50", "75", "100 %"])


# ------------------------------------------------------------------ curves


def draw_curves(numbers):
    """Small multiples, a sweep each, and the times."""
    figure, axes = plt.subplots(3, 3, figsize=(12, 8.6), layout="constrained")
    figure.get_layout_engine().set(w_pad=0.12, h_pad=0.10, rect=(0, 0.055, 1, 0.845))
    labels = list(numbers["time_ms"])
    for i, (axis, sweep) in enumerate(zip(axes.flat, SWEEPS, strict=False)):
        draw_sweep(figure, axis, sweep, numbers["found"][sweep.factor], labels)
        if i % 3:
            axis.set_yticklabels([])
    draw_times(axes.flat[-1], numbers["time_ms"])
    handles, names = axes.flat[0].get_legend_handles_labels()
    figure.suptitle("Objects found, % of frames", x=0.012, y=0.985, ha="left", fontsize=15, fontweight="bold")
    figure.legend(
        handles,
        names,
        loc="upper left",
        bbox_to_anchor=(0.003, 0.955),
        ncols=len(names),
        frameon=False,
        fontsize=12.5,
        handlelength=2.4,
        columnspacing=1.8,
    )
    n = numbers["objects"] * numbers["frames"]
    text = (
        f"{numbers['objects']} objects, {n} rendered frames of {WIDTH}x{HEIGHT} px a point, "
        f"good to ±{98 / math.sqrt(n):.0f} % at worst. What a panel does not name is plain:\n"
        "scale 0.5 to 1, any rotation, tilt to 20 degrees. Blur and noise: standard deviation. "
        "Lines that coincide are drawn side by side."
    )
    figure.text(0.012, 0.012, text, fontsize=10.5, color="#555555", linespacing=1.4)
    return figure


def draw_sweep(figure, axis, sweep, found, labels):
    """One panel of the curves: found against one factor, a line for each detector."""
    for k, label in enumerate(labels):
        beside = ScaledTranslation(0, ((len(labels) - 1) / 2 - k) * 1.3 / 72, figure.dpi_scale_trans)
        axis.plot(
            sweep.values,
            per_cent(found[label]),
            label=label,
            transform=axis.transData + beside,
            clip_on=False,
            **STYLES[label],
        )
    low, high = sweep.values[0], sweep.values[-1]
    if sweep.log:
        axis.set_xscale("log")
        axis.set_xlim(low * (low / high) ** 0.04, high * (high / low) ** 0.04)
    else:
        axis.set_xlim(low - 0.04 * (high - low), high + 0.04 * (high - low))
    axis.set_xticks(sweep.ticks, [f"{100 * t:.0f}" if sweep.percent else f"{t:g}" for t in sweep.ticks])
    axis.minorticks_off()
    axis.set_title(sweep.title)
    per_cent_axis(axis)


def draw_times(axis, times):
    """A bar for each detector, its name above and its time at the end."""
    most = max(times.values())
    for i, (label, ms) in enumerate(times.items()):
        axis.barh(i, ms, color=STYLES[label]["color"], height=0.34)
        axis.text(0, i - 0.26, label, va="bottom")
        axis.text(ms + 0.02 * most, i, f"{ms:.0f}", va="center", fontweight="bold")
    axis.set_title("Time a frame, ms (median)")
    axis.set_xlim(0, 1.15 * most)
    axis.set_ylim(len(times) - 0.6, -0.75)
    axis.xaxis.set_visible(False)
    axis.yaxis.set_visible(False)
    axis.spines[["bottom", "left"]].set_visible(False)


# ------------------------------------------------------------------ economy


def draw_economy(numbers):
    """Found against bytes: keygraph's lines, and the rivals' points."""
    figure, axis = plt.subplots(figsize=(8, 4.8), layout="constrained")
    figure.get_layout_engine().set(rect=(0, 0.05, 1, 0.95))
    per_cent_axis(axis)
    for preset, most in PRESETS[:-1]:
        axis.axvline(most / 1024, color="#888888", linewidth=1, linestyle=":")
        axis.text(most / 1024, 2, f" {preset}", color="#555555", fontsize=10)
    for label, points in numbers["found"].items():
        x, y = [n / 1024 for n in points["bytes"]], per_cent(points["all"])
        style = STYLES["Keygraph large" if label == "Keygraph" else label]
        axis.plot(x, y, **{**style, "markersize": 9 if len(x) == 1 else 5})
        # Both lines end at nearly the same place.
        below = len(x) > 1 and label != "Keygraph"
        axis.annotate(
            label,
            (x[-1], y[-1]),
            xytext=(10, -15 if below else 0),
            textcoords="offset points",
            va="center",
            color=style["color"],
            fontweight="bold",
        )
    axis.set_xscale("log")
    ticks = [32, 64, 128, 256, 512, 1024, 2048, 4096]
    axis.set_xticks(ticks, [f"{t} KB" if t < 1024 else f"{t // 1024} MB" for t in ticks])
    axis.minorticks_off()
    axis.set_xlim(24, 14_000)
    axis.set_title("Objects found, % of frames, against the model's size")
    n = numbers["objects"] * numbers["frames"]
    text = f"{numbers['objects']} objects, {n} rendered frames of each of: {'; '.join(CONDITIONS)}."
    figure.text(0.015, 0.018, text, fontsize=10, color="#555555")
    return figure


# ------------------------------------------------------------------ look-alikes


def draw_look_alikes(numbers):
    """Small multiples, a family each: its look-alikes beside half-hidden objects, against the least visible share."""
    families, rows = numbers["families"], -(-len(numbers["families"]) // 5)
    figure, axes = plt.subplots(rows, 5, figsize=(14, 0.9 + 2.5 * rows), layout="constrained", sharex=True, sharey=True)
    figure.get_layout_engine().set(w_pad=0.10, h_pad=0.10, rect=(0, 0.085, 1, 0.80))
    x, hidden = per_cent(numbers["min_visible"]), per_cent(numbers["found_hidden"])
    for axis, (family, row) in zip(axes.flat, families.items(), strict=False):
        axis.plot(x, hidden, "o-", color=BLUE, linewidth=1.8, label="half-hidden objects: found", clip_on=False)
        wrong = per_cent(row["wrong"])
        axis.plot(x, wrong, "D-", color=ORANGE, linewidth=2.2, label="look-alikes: wrong", clip_on=False, zorder=5)
        axis.set_title(family.capitalize() if family.islower() else family)
        axis.set_xticks([0, 20, 40, 60])
        per_cent_axis(axis)
    for above, axis in zip(axes.flat[len(families) - 5 :], axes.flat[len(families) :], strict=False):
        above.tick_params(labelbottom=True)
        axis.axis("off")
    handles, names = axes.flat[0].get_legend_handles_labels()
    title = "Look-alikes taken for the object, and half-hidden objects found, in 100 looks"
    figure.suptitle(title, x=0.012, y=0.985, ha="left", fontsize=15, fontweight="bold")
    place = dict(loc="upper left", bbox_to_anchor=(0.003, 0.945), ncols=2, frameon=False, fontsize=12.5)
    figure.legend(handles, names, **place)
    figure.supxlabel("--min-visible, % of the object", y=0.062, fontsize=11)
    looks = min(row["looks"] for row in families.values())
    text = (
        f"Of each family {numbers['groups']} groups of five pictures; each picture is looked for in frames that show "
        f"another of its group: {looks:,} looks. Half hidden: {numbers['objects']} objects, "
        f"{numbers['objects'] * numbers['hidden']:,} frames."
    )
    figure.text(0.012, 0.012, text, fontsize=10.5, color="#555555")
    return figure


# ------------------------------------------------------------------ growth


def draw_growth(numbers):
    """Four panels: time against objects, keygraphs, corners and pixels."""
    figure, axes = plt.subplots(1, 4, figsize=(14, 3.8), layout="constrained")
    by_objects, by_keygraphs, by_corners, by_pixels = axes
    rows = [r for r in numbers["objects"] if r["listed"] is None]
    for key, colour, what in (("ms", BLUE, "shown"), ("absent_ms", ORANGE, "absent")):
        by_objects.plot([r["objects"] for r in rows], [r[key] for r in rows], "o-", color=colour, label=what)
    name_points(by_objects, [(r["objects"], max(r["ms"], r["absent_ms"]), f"{100 * r['found']:.0f} %") for r in rows])
    by_objects.legend(frameon=False, loc="upper left")
    by_objects.set_title("Objects at once (and found)")
    points = numbers["keygraphs"]
    for key, colour in (("shown", BLUE), ("absent", ORANGE)):
        by_keygraphs.plot([p["keygraphs"] for p in points], [p[key] for p in points], "o-", color=colour, label=key)
    by_keygraphs.legend(frameon=False)
    by_keygraphs.set_title("Keygraphs of a model")
    by_corners.plot(*zip(*numbers["corners"], strict=True), "o", color=BLUE, alpha=0.6)
    by_corners.set_title("Corners in a frame")
    labelled(by_pixels, [(s["pixels"], s["ms"], s["profile"]) for s in numbers["sizes"]])
    by_pixels.set_title("Pixels of a frame")
    for axis in (by_objects, by_keygraphs, by_pixels):
        axis.set_xscale("log")
        axis.minorticks_off()
    by_objects.set_xticks([r["objects"] for r in rows], [f"{r['objects']:,}" for r in rows])
    for axis in axes:
        axis.set_ylim(0, 1.2 * axis.get_ylim()[1])
    by_objects.set_ylabel("ms a frame, one thread, median")
    return figure


def labelled(axis, points):
    """A line through (x, y, label) points, each with its label above."""
    axis.plot([x for x, _, _ in points], [y for _, y, _ in points], "o-", color=BLUE)
    name_points(axis, points)


def name_points(axis, points):
    """The label of each (x, y, label) above its point."""
    for x, y, text in points:
        axis.annotate(text, (x, y), xytext=(0, 8), textcoords="offset points", ha="center")
