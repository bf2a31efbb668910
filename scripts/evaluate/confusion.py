"""The command `look-alikes`: how well an object is told from pictures that share a part of its look.

Each member of a family is looked for, by itself, in frames that show another member: whatever
is reported is wrong. Half-hidden objects stand on the other side: what speaks against a
look-alike speaks against them too.
"""

from dataclasses import asdict

from alarms import print_reliability
from detectors import Keygraph, try_search
from figures import check_figure, draw_look_alikes, numbers_of, save
from frames import Renderer, Studio, build_renderer
from lookalikes import FAMILIES, FEWEST, MEMBERS, MOSTLY_SHARED, siblings
from pictures import read_pictures
from progress import Progress
from scoring import THRESHOLD, is_found, judge, reliability, shares_of

MIN_VISIBLE = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
HALF_HIDDEN = {"occlusion": 0.5}


def look_alikes(args, folder):
    """Draws docs/look-alikes.png anew, and prints three tables."""
    if args.redraw:
        numbers = numbers_of(args.out)
        return save(draw_look_alikes(numbers), numbers, args.out)
    check_figure(args.out)
    objects = read_pictures(args.objects, 1, "objects")
    pictures = read_pictures(args.backgrounds, FEWEST, "backgrounds")
    detector = Keygraph("look-alikes", args.keygraph, folder, args.train, threads=2)
    total = len(FAMILIES) * args.groups * MEMBERS**2 * args.frames + len(objects) * args.hidden
    looks = Looks(detector, Progress(total, "looks"))
    numbers = {"objects": len(objects), "hidden": args.hidden, "groups": args.groups, "frames": args.frames}
    numbers |= {"seed": args.seed, "min_visible": MIN_VISIBLE, "families": {}}
    with Studio(folder, pictures, args.seed, Renderer([build_renderer()])) as studio:
        numbers["found_hidden"] = hidden_objects(looks, studio, objects, args.hidden)
        for family in FAMILIES:
            numbers["families"][family] = alone(looks, studio, family, args)
    print_tables(numbers)
    numbers["reliability"] = {"all": print_scores("All families:", looks.scored, args.bins)}
    some = [row for row in looks.scored if row[2] not in MOSTLY_SHARED]
    title = f"Without {', '.join(MOSTLY_SHARED)}, of which half or more is shared:"
    numbers["reliability"]["less than half shared"] = print_scores(title, some, args.bins)
    return save(draw_look_alikes(numbers), numbers, args.out, args.keygraph)


class Looks:
    """The searches of a run, and the score of every detection, whether it is right, and the family it is of."""

    def __init__(self, detector, progress):
        self.detector, self.low, self.progress = detector, detector.thorough(0.0), progress
        self.scored = []

    def search(self, picture, frames, family=None):
        """Looks for `picture` in `frames`; the detections of each at the default threshold.

        Where there are none, all of the frame was searched: a thorough search shows what was not believed.
        """
        searches = list(try_search(self.detector, picture, frames))
        nothing = [frame for frame, search in searches if not search.detections]
        unbelieved = list(try_search(self.low, picture, nothing)) if nothing else []
        for frame, search in searches + unbelieved:
            verdicts = judge(search.detections, frame.quads.get(picture.digest))
            self.scored += [(d.score, v.right, family) for d, v in zip(search.detections, verdicts, strict=True)]
        self.progress.add(len(frames))
        return [search.detections for _, search in searches]


def hidden_objects(looks, studio, objects, frames):
    """The share of half-hidden objects that are found, for each value of MIN_VISIBLE."""
    seen = []
    for picture in objects:
        shot = [studio.shoot(picture, HALF_HIDDEN, "half hidden", n) for n in range(frames)]
        truth = [frame.quads[picture.digest] for frame in shot]
        seen += zip(looks.search(picture, shot), truth, strict=True)
        studio.clear(shot)
    return shares_of(seen, MIN_VISIBLE, is_found)


def alone(looks, studio, family, args):
    """What the looks for the members of one family come to."""
    own, wrong = [], []
    for group in range(args.groups):
        members, backgrounds = siblings(family, studio.backgrounds, args.seed, group, studio.folder)
        # A renderer keeps all pictures that it has read.
        with Studio(studio.folder, backgrounds, args.seed, Renderer([build_renderer()])) as room:
            for shown in members:
                shot = [room.shoot(shown, {}, family, group, n) for n in range(args.frames)]
                for sought in members:
                    truth = [frame.quads.get(sought.digest) for frame in shot]
                    seen = zip(looks.search(sought, shot, family), truth, strict=True)
                    (own if sought is shown else wrong).extend(seen)
                room.clear(shot)
    return {
        "looks": len(wrong),
        "own": shares_of(own, [0.0], is_found)[0],
        "wrong": shares_of(wrong, MIN_VISIBLE, lambda found, _: bool(found)),
    }


def print_scores(title, scored, bins):
    """Prints a table of reliability; gives its rows."""
    pairs = [(score, right) for score, right, _ in scored]
    print(f"\n{title}\n")
    print_reliability(pairs, bins)
    return [asdict(row) for row in reliability(pairs, bins)]


def print_tables(numbers):
    """Prints what is wrong by family, and what a minimum of the visible share changes."""
    families, hidden = numbers["families"], numbers["objects"] * numbers["hidden"]
    print(f"At {THRESHOLD:g} and above:\n")
    print("| family | looks for a sibling | wrong in 100 | own frames found in 100 |\n| --- | --- | --- | --- |")
    for family, row in families.items():
        print(f"| {family} | {row['looks']:,} | {100 * row['wrong'][0]:.0f} | {100 * row['own']:.0f} |")
    head = [f"`--min-visible {v:g}`" if v == 0 else f"{v:g}" for v in numbers["min_visible"]]
    print(f"\n| in 100 | {' | '.join(head)} |\n|{' --- |' * (1 + len(head))}")
    rows = {family: row["wrong"] for family, row in families.items()}
    rows[f"half-hidden objects found, of {hidden:,}"] = numbers["found_hidden"]
    for name, row in rows.items():
        print(f"| {name} | {' | '.join(f'{100 * v:.0f}' for v in row)} |")
    print(flush=True)
