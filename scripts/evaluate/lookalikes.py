"""Families of look-alikes: pictures that share a part of their look, as codes, cards, forms and packages do.

In: photographs. Out: groups of five pictures of one family, all of them different.

A family is a function of two sources. What it takes from `ours` is the same in all members of
a group, what it takes from `own` is another in each. So it takes from `ours` first, and as much
in each member. The seed, the family, the group and the member decide what a source gives,
together with the photographs and the version of OpenCV. A member's photographs are never those
of a sibling, and never the background of a frame.
"""

import os

import cv2
import numpy as np
from pictures import read_picture

MEMBERS = 5  # of a group
FEWEST = MEMBERS + 2  # photographs: one of each member, and two for backgrounds

SYLLABLES = "ba ce di fo gu ha ki lo mu na pe ra si to ve zu".split()
BLACK, DARK, GRAY, PALE, WHITE = ((v, v, v) for v in (10, 50, 120, 225, 255))
SANS, SERIF, BOLD, HAND = (
    cv2.FONT_HERSHEY_DUPLEX,
    cv2.FONT_HERSHEY_COMPLEX,
    cv2.FONT_HERSHEY_TRIPLEX,
    cv2.FONT_HERSHEY_SCRIPT_SIMPLEX,
)


class Source:
    """What pictures are made of: numbers, colours, words and parts of photographs, at random."""

    def __init__(self, photographs, member, *seed):
        self.photographs, self.member, self.rng = photographs, member, np.random.default_rng(seed)

    def number(self, low, high):
        """A whole number of `low` to `high`."""
        return int(self.rng.integers(low, high + 1))

    def digits(self, n):
        """`n` digits."""
        return "".join(map(str, self.rng.integers(0, 10, n)))

    def colour(self, low=0, high=255):
        """Blue, green and red."""
        return tuple(self.number(low, high) for _ in range(3))

    def place(self, pixels):
        """A pixel: x, y."""
        return self.number(0, pixels.shape[1] - 1), self.number(0, pixels.shape[0] - 1)

    def words(self, n):
        """`n` words of one to four syllables that mean nothing."""
        return " ".join("".join(self.rng.choice(SYLLABLES, self.number(1, 4))) for _ in range(n))

    def part(self, width, height):
        """A part of a photograph in which there is something to see, as `width` x `height` px."""
        for _ in range(20):
            photo = self.photographs[self.number(0, len(self.photographs) - 1)]
            most = min(photo.shape[1] / width, photo.shape[0] / height)
            w, h = (max(8, int(self.rng.uniform(0.4, 0.9) ** 0.5 * most * side)) for side in (width, height))
            x, y = self.number(0, photo.shape[1] - w), self.number(0, photo.shape[0] - h)
            part = photo[y : y + h, x : x + w]
            if part.std() > 20:
                break
        tint = self.rng.uniform(0.7, 1.2, 3)
        part = cv2.resize(part, (width, height), interpolation=cv2.INTER_AREA)
        return np.clip(part * tint, 0, 255).astype(np.uint8)


def sheet(width, height, colour=WHITE):
    """A picture of one colour."""
    return np.full((height, width, 3), colour, np.uint8)


def write(pixels, text, at, size=0.5, colour=DARK, thick=1, font=SANS):
    """Writes `text` from `at`, the left end of its base line."""
    cv2.putText(pixels, text, at, font, size, colour, thick, cv2.LINE_AA)


def box(pixels, at, width, height, colour, line=-1):
    """Draws a rectangle from its upper left corner, filled unless `line` is its width."""
    cv2.rectangle(pixels, at, (at[0] + width - 1, at[1] + height - 1), colour, line)


def paste(pixels, part, at):
    """Lays a part over the picture, its upper left corner at `at`."""
    pixels[at[1] : at[1] + part.shape[0], at[0] : at[0] + part.shape[1]] = part


def bars(source, pixels, at, width, height):
    """Draws a bar code."""
    box(pixels, at, width, height, WHITE)
    x = at[0] + 4
    while x < at[0] + width - 8:
        line = source.number(1, 4)
        box(pixels, (x, at[1]), line, height, BLACK)
        x += line + source.number(1, 4)


# ------------------------------------------------------------------ the families


def code(ours, own):
    """Codes of one version: the squares in the corners, the timing and the first words are shared."""
    text = "HTTPS://EXAMPLE.ORG/" + own.digits(ours.number(8, 60))
    modules = cv2.QRCodeEncoder.create().encode(text)
    framed = cv2.copyMakeBorder(modules, 2, 2, 2, 2, cv2.BORDER_CONSTANT, value=255)
    return cv2.cvtColor(cv2.resize(framed, (480, 480), interpolation=cv2.INTER_NEAREST), cv2.COLOR_GRAY2BGR)


def page(ours, own):
    """Pages of print in one font and one layout."""
    font, size, columns = (SANS, SERIF)[ours.number(0, 1)], ours.number(42, 54) / 100, ours.number(1, 2)
    pixels = sheet(480, 640, (245, 250, 252))
    write(pixels, own.words(2).title(), (36, 62), 0.9, BLACK, 2, BOLD)
    width = 408 // columns - 12 * (columns - 1)
    for x in range(36, 444, 408 // columns + 6):
        for y in range(104, 612, 22):
            write(pixels, line_of(own, width, font, size), (x, y), size, DARK, 1, font)
    return pixels


def line_of(source, width, font, size):
    """Words that fill a line of `width` px."""
    line = source.words(1)
    while True:
        longer = f"{line} {source.words(1)}"
        if cv2.getTextSize(longer, font, size, 1)[0][0] > width:
            return line
        line = longer


# Pips of each rank: in each of two columns, and in the middle.
PIPS = {2: (0, 2), 3: (0, 3), 4: (2, 0), 5: (2, 1), 6: (3, 0), 7: (3, 1), 8: (4, 0), 9: (4, 1), 10: (4, 2)}


def card(ours, own):
    """Playing cards with the index in one corner: one layout, another rank or suit."""
    deck = ours.rng.permutation(4 * len(PIPS))
    rank, suit = list(PIPS)[deck[own.member] // 4], int(deck[own.member] % 4)
    colour, maker = ((40, 30, 200), (25, 25, 25))[suit % 2], ours.words(2).upper()
    pixels = sheet(400, 560, (248, 250, 250))
    box(pixels, (8, 8), 384, 544, GRAY, 2)
    write(pixels, str(rank), (22, 66), 1.6, colour, 3)
    draw_suit(pixels, suit, (44, 98), 20, colour)
    write(pixels, maker, (150, 538), 0.45, GRAY)
    sides, middle = PIPS[rank]
    for x, n in ((130, sides), (270, sides), (200, middle)):
        for i in range(n):
            draw_suit(pixels, suit, (x, int(280 + (i - (n - 1) / 2) * 400 / max(n, 3))), 38, colour)
    return pixels


def draw_suit(pixels, suit, at, size, colour):
    """Draws diamonds, spades, hearts or clubs (0 to 3), upright."""
    t = np.linspace(0, 2 * np.pi, 40)
    heart = np.stack([np.sin(t) ** 3, -(13 * np.cos(t) - 5 * np.cos(2 * t) - 2 * np.cos(3 * t)) / 16], -1)
    diamond, stem = np.array([(0, -1), (0.7, 0), (0, 1), (-0.7, 0)]), np.array([(0, 0), (0.35, 1), (-0.35, 1)])
    leaves = [0.45 * np.stack([np.sin(t), np.cos(t)], -1) + at for at in ((-0.5, 0.15), (0.5, 0.15), (0, -0.5))]
    shapes = ([diamond], [-0.8 * heart, stem], [heart], [*leaves, stem])[suit]
    for shape in shapes:
        cv2.fillPoly(pixels, [np.int32(np.round(shape * size + at))], colour, cv2.LINE_AA)


def deck(ours, own):
    """Playing cards with the index in two opposite corners, upright both ways, and fewer pips in the middle."""
    order = ours.rng.permutation(4 * len(PIPS))
    rank, suit = list(PIPS)[order[own.member] // 4], int(order[own.member] % 4)
    colour, size = ((35, 30, 195), (22, 22, 22))[suit % 2], ours.number(34, 44)
    corner = sheet(400, 560, (250, 250, 250))
    write(corner, str(rank), (18, 58), 1.5, colour, 3)
    draw_suit(corner, suit, (38, 88), 18, colour)
    pixels = np.minimum(corner, corner[::-1, ::-1])
    box(pixels, (7, 7), 386, 546, GRAY, 2)
    sides, middle = PIPS[rank]
    for x, n in ((126, sides), (274, sides), (200, middle)):
        for i in range(n):
            draw_suit(pixels, suit, (x, int(280 + (i - (n - 1) / 2) * 340 / max(n - 1, 1))), size, colour)
    # The maker's name tells which side is up.
    write(pixels, ours.words(1)[:12], (150, 536), 0.5, GRAY)
    return pixels


def icons(ours, own):
    """Pages of a phone: one grid and ground, other icons and captions."""
    bottom, top, side = ours.colour(20, 120), ours.colour(20, 120), 80
    down = np.linspace(0, 1, 720)[:, None, None]
    pixels = np.uint8((np.array(top) * (1 - down) + np.array(bottom) * down) * np.ones((1, 480, 1)))
    x, y = np.meshgrid(*[np.linspace(-1, 1, side)] * 2)
    inside = (np.abs(x) ** 5 + np.abs(y) ** 5 < 1)[..., None]
    for row in range(5):
        for column in range(4):
            at = 28 + column * 114, 40 + row * 134
            icon = own.part(side, side)
            if own.number(0, 1):
                icon = sheet(side, side, own.colour(40, 255))
                write(icon, own.words(1)[0].upper(), (18, 62), 2, own.colour(0, 255), 5, BOLD)
            ground = pixels[at[1] : at[1] + side, at[0] : at[0] + side]
            paste(pixels, np.where(inside, icon, ground), at)
            write(pixels, own.words(1)[:8], (at[0] + 4, at[1] + side + 22), 0.5, WHITE)
    return pixels


def apps(ours, own):
    """Pages of a phone whose icons are signs on bright grounds, or pictures: they look more alike than `icons`."""
    ground, side, gap = ours.colour(10, 100), ours.number(72, 92), ours.number(24, 40)
    pixels = np.uint8(np.linspace(1.3, 0.7, 720)[:, None, None] * np.array(ground) * np.ones((1, 480, 1)))
    columns = (480 - gap) // (side + gap)
    left = (480 - columns * (side + gap) + gap) // 2
    mask = sheet(side, side, BLACK)
    round_corners(mask, side // 5)
    for y in range(gap, 720 - side - 34, side + gap + 28):
        for column in range(columns):
            at = left + column * (side + gap), y
            icon = own.part(side, side)
            if own.number(0, 1):
                icon = sheet(side, side, own.colour(70, 255))
                middle, size = (side // 2, side // 2), own.number(side // 7, side // 3)
                cv2.circle(icon, middle, size, WHITE, (-1, 7)[own.number(0, 1)], cv2.LINE_AA)
            place = pixels[at[1] : at[1] + side, at[0] : at[0] + side]
            paste(pixels, np.where(mask > 128, icon, place), at)
            write(pixels, own.words(1)[:7], (at[0] + 6, at[1] + side + 20), 0.5, PALE)
    return pixels


def round_corners(mask, radius):
    """Fills all of a square but its corners."""
    side = mask.shape[0]
    for inset in ((radius, 0), (0, radius)):
        box(mask, inset, side - 2 * inset[0], side - 2 * inset[1], WHITE)
    for x in (radius, side - 1 - radius):
        for y in (radius, side - 1 - radius):
            cv2.circle(mask, (x, y), radius, WHITE, -1, cv2.LINE_AA)


def signs(ours, own):
    """Boards of signs that differ in their colours, not in their brightness."""
    pixels, side, light = sheet(480, 720, ours.colour(20, 90)), 480 // ours.number(2, 4), ours.number(80, 150)
    inset = side // ours.number(8, 14)
    for y in range(0, 721 - side, side):
        for x in range(0, 481 - side, side):
            box(pixels, (x + inset, y + inset), side - 2 * inset, side - 2 * inset, colour_of(own, light))
            middle, size = (x + side // 2, y + side // 2), ours.number(side // 8, side // 4)
            cv2.circle(pixels, middle, size, PALE, (-1, 7)[ours.number(0, 1)], cv2.LINE_AA)
    return pixels


def colour_of(source, luma):
    """A colour that is as bright as `luma` says."""
    shares = np.array((0.114, 0.587, 0.299))
    for _ in range(50):
        colour = np.array(source.colour(20, 255))
        colour = colour * luma / (colour @ shares)
        if colour.max() <= 255:
            return colour.astype(int).tolist()
    return [luma] * 3


def package(ours, own):
    """Packages of one brand: a band of 35 % of the area is shared."""
    pixels = sheet(420, 620)
    box(pixels, (0, 0), 420, 217, ours.colour(30, 200))
    write(pixels, ours.words(1).title(), (22, 96), 2.2, WHITE, 6, BOLD)
    paste(pixels, ours.part(110, 80), (294, 124))
    for i in range(8):
        cv2.circle(pixels, (40 + 32 * i, 164), 12, ours.colour(), -1, cv2.LINE_AA)
    paste(pixels, own.part(420, 403), (0, 217))
    write(pixels, own.words(2).title(), (22, 580), 1.2, WHITE, 3)
    return pixels


def form(ours, own):
    """Forms: one print, filled in by hand."""
    pixels, y = sheet(460, 640, (250, 252, 252)), 112
    box(pixels, (20, 22), 420, 62, ours.colour(0, 160))
    write(pixels, ours.words(2).upper(), (36, 62), 0.9, WHITE, 2)
    ink = own.colour(0, 110)
    while y < 590:
        height, x = ours.number(28, 50), ours.number(130, 210)
        box(pixels, (22, y), x, height, GRAY, 1)
        box(pixels, (22 + x, y), 416 - x, height, GRAY, 1)
        write(pixels, ours.words(1).title()[:10] + ":", (28, y + 19), 0.5, DARK)
        entry = own.words(2) if own.number(0, 1) else own.digits(9)
        write(pixels, entry[: (400 - x) // 12], (32 + x, y + 22), 0.7, ink, 1, HAND)
        y += height
    return pixels


def ticket(ours, own):
    """Tickets: one event, other seats, dates and codes."""
    pixels = sheet(600, 260, ours.colour(170, 250))
    paste(pixels, ours.part(124, 124), (16, 16))
    colour = ours.colour(0, 140)
    write(pixels, ours.words(1).title(), (156, 66), 1.3, colour, 2, BOLD)
    cv2.line(pixels, (440, 0), (440, 259), GRAY, 2)
    write(pixels, f"ROW {own.digits(2)}  SEAT {own.digits(2)}", (156, 120), 0.8, BLACK, 2)
    write(pixels, own.words(3), (18, 194), 0.7, colour)
    write(pixels, f"{own.digits(2)}.{own.digits(2)}.20{own.digits(2)}  {own.digits(2)}:{own.digits(2)}", (18, 238), 0.8)
    bars(own, pixels, (456, 24), 128, 140)
    write(pixels, own.digits(10), (460, 192), 0.5)
    return pixels


def town(ours, own):
    """Sheets of one map: the frame, the legend and the colours are shared."""
    ground, road = ours.colour(215, 245), ours.colour(90, 220)
    park, water = ours.colour(150, 215), ours.colour(150, 215)
    pixels = sheet(520, 520, ground)
    for i in range(8):
        cv2.circle(pixels, own.place(pixels), own.number(25, 100), (park, water)[i % 2], -1, cv2.LINE_AA)
    for _ in range(26):
        ends, width = (own.place(pixels), own.place(pixels)), (3, 3, 5, 9)[own.number(0, 3)]
        cv2.line(pixels, *ends, GRAY, width + 2, cv2.LINE_AA)
        cv2.line(pixels, *ends, road if width > 5 else WHITE, width, cv2.LINE_AA)
    for _ in range(22):
        write(pixels, own.words(1).title(), own.place(pixels), 0.45)
    box(pixels, (0, 0), 520, 520, DARK, 10)
    box(pixels, (370, 410), 150, 110, WHITE)
    box(pixels, (370, 410), 150, 110, DARK, 4)
    for i, colour in enumerate((park, water, road)):
        box(pixels, (384, 424 + 30 * i), 24, 20, colour)
        write(pixels, ours.words(1)[:8], (416, 440 + 30 * i))
    return pixels


def keyboard(ours, own):
    """Keyboards: the keys are at the same places, with other letters on them."""
    shade = ours.number(25, 70)
    ground, key, ink = (BLACK, (shade,) * 3, PALE) if ours.number(0, 1) else (GRAY, PALE, DARK)
    pixels = sheet(640, 244, ground)
    for row, keys in enumerate((13, 13, 12, 11, 9)):
        left = (16, 16, 32, 52, 100)[row]
        for column in range(keys):
            at = left + 47 * column, 16 + 43 * row
            box(pixels, at, 41, 37, key)
            write(pixels, chr(own.number(65, 90)), (at[0] + 9, at[1] + 27), 0.8, ink)
    return pixels


def label(ours, own):
    """Labels of a shelf: one shop, another price and name."""
    pixels = sheet(400, 240)
    box(pixels, (0, 0), 400, 52, ours.colour(0, 190))
    write(pixels, ours.words(1).upper()[:9], (14, 38), 1.1, WHITE, 3)
    write(pixels, "per kg", (14, 130), 0.5, GRAY)
    write(pixels, own.words(3)[:30], (14, 86), 0.7)
    write(pixels, f"{own.digits(1)}.{own.digits(2)}", (160, 196), 2.8, BLACK, 6)
    write(pixels, own.digits(3), (84, 130), 0.5, GRAY)
    bars(own, pixels, (12, 152), 124, 72)
    box(pixels, (1, 1), 398, 238, GRAY, 2)
    return pixels


def sequel(ours, own):
    """Cases of one series of films: the frame around the picture is shared."""
    pixels = sheet(450, 640, ours.colour(0, 120))
    write(pixels, ours.words(1).upper(), (24, 84), 1.7, ours.colour(150, 255), 4, BOLD)
    write(pixels, ours.words(4), (28, 602), 0.6, PALE)
    paste(pixels, ours.part(100, 60), (330, 524))
    paste(pixels, own.part(410, 390), (20, 116))
    write(pixels, own.digits(1), (374, 92), 2.2, WHITE, 5)
    return pixels


def series(ours, own):
    """Covers of one series of books: half of the picture is shared."""
    pixels = ours.part(440, 600)
    write(pixels, ours.words(1).title(), (20, 76), 1.8, WHITE, 5, BOLD)
    paste(pixels, own.part(420, 290), (10, 300))
    write(pixels, own.words(2), (28, 566), 1, WHITE, 2)
    return pixels


def badge(ours, own):
    """One badge, a fifth of the area, in the middle of other pictures."""
    middle, name = ours.part(220, 220), ours.words(1).upper()[:8]
    pixels = own.part(440, 560)
    paste(pixels, middle, (110, 170))
    box(pixels, (110, 170), 220, 220, WHITE, 6)
    write(pixels, name, (124, 374), 1.3, WHITE, 4)
    return pixels


FAMILIES = {
    "QR codes": code,
    "pages of print": page,
    "forms": form,
    "tickets": ticket,
    "shelf labels": label,
    "keyboards": keyboard,
    "maps": town,
    "playing cards": card,
    "icons": icons,
    "one brand": package,
    "sequels": sequel,
    "one series": series,
    "one badge": badge,
    "apps": apps,
    "decks": deck,
    "signs": signs,
}
# Families of which half of the area or more is shared: a sibling shows as much as an object half of which is hidden.
MOSTLY_SHARED = ("forms", "tickets", "shelf labels", "keyboards", "one series")


# ------------------------------------------------------------------ groups


def member(family, photographs, seed, group, index):
    """The pixels of one member; `photographs` are those of each member, as `share` gives them."""
    key = (seed, list(FAMILIES).index(family), group)
    ours = Source([photo for own in photographs for photo in own], index, *key)
    own = Source(photographs[index], index, *key, 1 + index)
    return FAMILIES[family](ours, own)


def share(photographs, seed, group):
    """Shares photographs out: a list for each member of a group, and a list for backgrounds."""
    order = [photographs[i] for i in np.random.default_rng((seed, group)).permutation(len(photographs))]
    behind = max(2, len(order) // 4)
    return [order[behind + i :: MEMBERS] for i in range(MEMBERS)], order[:behind]


def siblings(family, pictures, seed, group, folder):
    """The pictures of one group, written into `folder`, and those of `pictures` for backgrounds."""
    parts, backgrounds = share(pictures, seed, group)
    pixels, found = [[picture.pixels for picture in own] for own in parts], []
    for index in range(MEMBERS):
        path = os.path.join(folder, f"{family.replace(' ', '-')}-{group}-{index}.png")
        cv2.imwrite(path, member(family, pixels, seed, group, index))
        found.append(read_picture(path))
    return found, backgrounds
