"""Tables of pages, made of records: a function each gives the lines of one table."""

from record import read_record

METHODS = {"keygraph large": "large", "keygraph standard": "standard", "SIFT": "sift", "ORB": "orb"}
# Rows of found frames: title, the scorer's kind and groups (none: all), whether the tight ones are told.
REAL = [
    ("real, object shown", "real", None, True),
    ("— book on a table, video", "real", ("book-mvg",), False),
    ("— picture cube turned by hand", "real", ("cube",), False),
    ("— DVD covers, four phones and cameras", "real", ("dvd",), False),
    ("— graffiti wall at 20 to 60 degrees", "real", ("graf",), False),
    ("— a box, a card, a gray box", "real", ("breakingbad", "mindcard", "box_gray"), False),
]
PLAIN = ("plain", "small", "large", "tilt-mild", "tilt-strong")
RENDERED = [
    ("rendered: plain, small, large, mild and strong tilt", "synth", PLAIN, False),
    ("rendered: dark and noisy", "synth", ("dark-noisy",), False),
    ("rendered: blurred, 2 px and 4 px", "synth", ("blurred", "very-blurred"), False),
    ("rendered: colour cast of 15 % and 30 %", "synth", ("colour-cast", "strong-cast"), False),
    ("rendered: tilted to the extreme", "synth", ("tilt-extreme",), True),
    ("rendered: nearly black", "synth", ("very-dark",), False),
    ("rendered: 30 % hidden", "synth", ("occluded",), False),
    ("rendered: 50 % hidden", "synth", ("half-hidden",), True),
    ("rendered, all", "synth", None, True),
]
SHORT = [
    ("rendered, all: found", "synth", None, False),
    ("— nearly black", "synth", ("very-dark",), False),
    ("— 50 % hidden", "synth", ("half-hidden",), False),
    ("— tilted to the extreme", "synth", ("tilt-extreme",), False),
]


def accuracy():
    """All rows of found frames, by method."""
    return [*head(["frames", "", *METHODS]), *map(found, REAL), absent_row(), *map(found, RENDERED), misplaced_row()]


def accuracy_short():
    """The rows of the README."""
    real = found(("real, object shown: found", "real", None, False))
    return [*head(["frames", "", *METHODS]), real, absent_row(), *map(found, SHORT), misplaced_row()]


def counts(method, kind, names=None):
    """The counts of a method in the groups of `kind` that `names` names; without names in all."""
    groups = read_record("accuracy")[METHODS.get(method, method)]
    rows = [
        row for group, row in groups.items() if group.startswith(f"{kind}/") and (names is None or stem(group) in names)
    ]
    return {key: sum(row[key] for row in rows) for key in ("frames", "shown", "found", "tight", "false")}


def stem(group):
    """`dvd` for real/dvd-004, else the name as it is."""
    name = group.split("/", 1)[1]
    return "dvd" if name.startswith("dvd-") else name


def absent(method):
    """Frames of a method that do not show the object, and the detections in them."""
    groups = read_record("accuracy")[METHODS.get(method, method)]
    rows = [row for group, row in groups.items() if row["shown"] == 0 and ", all" not in group]
    return sum(row["frames"] for row in rows), sum(row["false"] for row in rows)


def found(line):
    """A row of found frames."""
    title, kind, names, tight = line
    told = [counts(method, kind, names) for method in METHODS]
    cells = [f"{c['found']:,}" + (f", tight {c['tight']:,}" if tight else "") for c in told]
    return row([title, f"{told[0]['shown']:,}", *cells])


def absent_row():
    """The row of false alarms."""
    by_method = [absent(method) for method in METHODS]
    return row(["real, object absent: false alarms", f"{by_method[0][0]:,}", *(str(false) for _, false in by_method)])


def misplaced_row():
    """The row of outlines that lie elsewhere."""
    by_method = [counts(method, "synth") for method in METHODS]
    return row(
        ["rendered: outlines at a wrong place", f"{by_method[0]['shown']:,}", *(str(c["false"]) for c in by_method)]
    )


def times(told=None):
    """Time of a frame, ours and OpenCV's."""
    told = told or read_record("rivals")
    frames = told["frames"]
    ours = {f"keygraph {p}": (b["total"]["median_ms"], b["detections"]) for p, b in told["keygraph"].items()}
    theirs = {f"OpenCV {label}": (told["opencv_ms"][label], n) for label, n in told["opencv_found"].items()}
    lines = [row([who, f"{ms:.1f}", f"{n} of {frames}"]) for who, (ms, n) in (ours | theirs).items()]
    return head([f"{frames} frames of the sequence, one object, one thread", "ms, median", "frames found"]) + lines


def mixed():
    """Time by what a frame shows: median and 99th percentile."""
    return by_kind(read_record("mixed")["detectors"])


def together():
    """The same when some threads search each frame together."""
    return by_kind({f"{n} thread{'s'[: int(n) - 1]}": rows for n, rows in read_record("mixed")["threads"].items()})


def by_kind(table):
    """Median and 99th percentile by what a frame shows, a line for each label."""
    kinds = {"plain": "plainly", "hard": "with difficulty", "absent": "not at all", "all": "all three"}
    lines = []
    for label, rows in table.items():
        cells = [f"{rows[kind]['median_ms']:.1f}, {rows[kind]['p99_ms']:.1f}" for kind in kinds]
        lines.append(row([label, *cells]))
    return head(["median and 99th percentile, ms", *kinds.values()]) + lines


def tilt(told=None):
    """Found from far to the side, by tilt, and what a frame costs that does not show the object."""
    told = told or read_record("tilt")
    lines = []
    for label, numbers in told["detectors"].items():
        cells = [str(n) for n in numbers["found"].values()]
        alarms, ms = str(numbers["false_alarms"]), f"{numbers['absent_ms']:.0f}"
        lines.append(row([label, *cells, str(numbers["misplaced"]), alarms, ms]))
    angles = [f"{a}°" for a in next(iter(told["detectors"].values()))["found"]]
    return head([f"found of {told['frames']}, tilted by", *angles, "wrong place", "absent: alarms", "ms"]) + lines


def stages(told=None):
    """Time of each stage, and of what OpenCV has instead, ms."""
    told = told or read_record("rivals")
    first, times = next(iter(told["keygraph"].values())), told["opencv_ms"]
    ours = {stage: v["median_ms"] for stage, v in first["stages"].items()}
    corners = "corners, of the levels searched (OpenCV: goodFeaturesToTrack, of the frame)"
    triangles = f"triangulation, nested, of the levels searched (OpenCV: Subdiv2D of {told['points']} points)"
    rows = [
        ("a plain copy of gray and RGB", None, f"{times['copy of gray and RGB']:.3f}"),
        ("luma and chroma (OpenCV: gray; HSV)", ours.pop("convert"), f"{times['gray']:.2f}; {times['HSV']:.2f}"),
        (corners, ours.pop("corners"), f"{times['goodFeaturesToTrack']:.2f}"),
        (triangles, ours.pop("delaunay"), f"{times['Subdiv2D']:.2f}"),
        *((stage, ms, "") for stage, ms in ours.items()),
        ("followed, not searched", first["tracking"]["times"]["median_ms"], ""),
    ]
    lines = [row([title, "" if ms is None else f"{ms:.2f}", other]) for title, ms, other in rows]
    return head(["stage", "ours, ms", "OpenCV, ms"]) + lines


def growth():
    """Time against objects."""
    return growth_rows("objects", lambda r: f"{r['objects']:,}", lambda r: r["listed"] is None)


def listed():
    """The largest number of objects, with fewer keygraphs of each."""
    rows = read_record("growth")["objects"]
    most = max(r["objects"] for r in rows)
    return growth_rows(
        "`--listed`", lambda r: f"{r['listed']:,}" if r["listed"] else "—", lambda r: r["objects"] == most
    )


def growth_rows(title, first, wanted):
    """A table of the rows of `growth` that are wanted; `first` gives their first cell."""
    lines = [
        row(
            [
                first(r),
                f"{100 * r['found']:.0f} %",
                f"{r['ms']:.3g}",
                f"{r['absent_ms']:.3g}",
                megabytes(r["bytes"]),
                megabytes(r["slim_bytes"]) if r["objects"] > 1 else "—",
                f"{r['start_s']:.2g}",
            ]
        )
        for r in read_record("growth")["objects"]
        if wanted(r)
    ]
    titles = [title, "found", "ms a frame", "ms, absent", "pack, MB", "slim, MB", "first frame after, s"]
    return head(titles) + lines


def megabytes(n):
    """Bytes as MB, with the digits that mean something."""
    return f"{n / 1e6:,.3g}" if n < 1e9 else f"{n / 1e6:,.0f}"


MOTIONS = {
    "still": "rendered: still",
    "slow": "rendered: slow, turning and tilting",
    "fast": "rendered: fast, up to 30 px a frame",
    "jumps": "rendered: jumps of 25 px",
    "leaving": "rendered: leaves and comes back elsewhere",
    "hidden": "rendered: a cover passes before the object",
    "copies": "rendered: two copies that pass each other",
    "book-mvg": "book on a table, every sixth frame",
    "book-mvg-video": "book on a table, every frame",
    "cube": "picture cube turned by hand, every eighth frame",
}


def sequences(told=None):
    """Tracking beside searching every frame: videos first, then what is rendered."""
    told = told or [read_record("tracking-videos"), read_record("tracking")]
    lines = []
    for r in (r for record in told for r in record["sequences"]):
        pairs = [", ".join(map(str, r[key][:2])) for key in ("found", "elsewhere")]
        pairs += [", ".join(f"{v:.3f}" for v in r[key]) for key in ("error_px", "jitter_px")]
        searched = f"{r['searched_when_tracking']} of {r['frames']}"
        lines.append(row([MOTIONS.get(r["name"], r["name"]), str(r["shown"]), *pairs, searched]))
    pairs = [f"{what}: searched, tracked" for what in ("found", "elsewhere")]
    pairs += [f"{what}: searched, tracked, smoothed" for what in ("error, px", "jitter, px")]
    return head(["sequence", "frames that show the object", *pairs, "frames searched when tracking"]) + lines


def memory():
    """The largest resident sizes of a camera."""
    lines = []
    for r in read_record("memory")["runs"]:
        what = ", ".join(
            f"{n:,} {thing}{'s' if n > 1 else ''}"
            for n, thing in (
                (r["models"], f"{r['preset']} model"),
                (r["viewers"], "viewer"),
                (r["learners"], "learner"),
                (r["frames"], "frame"),
            )
            if n
        )
        lines.append(row([what, f"{r['peak_kb']:,}"]))
    return head(["run", "peak (`VmHWM`), kB of 262,144"]) + lines


def cluster(told=None):
    """Frames a second by the number of workers."""
    told = told or read_record("cluster")
    return head(["workers", "frames a second"]) + [row([n, f"{rate:.0f}"]) for n, rate in told["workers"].items()]


# Timed by hand beside ours.
MINDAR = {"training": "3.6 s", "model": "0.37 MB", "a search": "57 ms", "following": "", "found": "8"}


def web():
    """Times of the browser package, and of MindAR."""
    told = read_record("web")
    ours = {
        "training": f"{told['train_s']:.1f} s",
        "model": f"{told['model_mb']:.1f} MB (`compact`: {told['compact_mb']:.2f} MB)",
        "a search": f"{told['search_ms']:.1f} ms",
        "following": f"{told['follow_ms']:.1f} ms",
        "found": str(told["found"]),
    }
    titles = {"found": "found in every fourth frame of the sequence, 9 of which show the picture"}
    lines = [row([titles.get(what, what), value, MINDAR[what]]) for what, value in ours.items()]
    return head(["", "Keygraph", "MindAR 1.2.5"]) + lines


def lenses(told=None):
    """Calibrations by a picture and by a chessboard, three runs each."""
    told = told or read_record("lenses")
    lines = []
    for lens in told["lenses"]:
        cells = []
        for who in ("keygraph", "opencv"):
            runs = [run[who] for run in lens["runs"]]
            for key in ("views", "focal_percent", "corner_px"):
                cells.append(", ".join(str(run.get(key, "refused")) for run in runs))
        lines.append(row([lens["name"], *cells]))
    each = "views used", "focal length, % off", "px at the frame's corners"
    return head(["lens", *each, *(f"OpenCV: {what}" for what in each)]) + lines


def head(columns):
    """The first two lines of a table."""
    return [row(columns), row(["---"] * len(columns))]


def row(cells):
    """One line of a table."""
    return "| " + " | ".join(cells).replace("|  |", "| |") + " |"


TABLES = {
    "accuracy": accuracy,
    "accuracy-short": accuracy_short,
    "times": times,
    "mixed": mixed,
    "together": together,
    "tilt": tilt,
    "stages": stages,
    "growth": growth,
    "listed": listed,
    "sequences": sequences,
    "memory": memory,
    "lenses": lenses,
    "cluster": cluster,
    "web": web,
}
