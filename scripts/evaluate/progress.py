"""How far a run is, and how long it will take, on standard error."""

import sys
import time


class Progress:
    """A count of work done; `total` is what there is to do, in `unit`s."""

    def __init__(self, total, unit):
        self.total, self.unit, self.done = total, unit, 0
        self.start = self.told = time.monotonic()

    def add(self, n):
        """Counts `n` more, and prints a line now and then."""
        self.done += n
        now = time.monotonic()
        live = sys.stderr.isatty()
        if now - self.told < (0.5 if live else 20) and self.done < self.total:
            return
        self.told = now
        left = (now - self.start) * max(0, self.total - self.done) / self.done
        line = f"{self.done:,} of {self.total:,} {self.unit}, {left // 60:.0f} min {left % 60:.0f} s left"
        end = "" if live and self.done < self.total else "\n"
        print(("\r\x1b[K" if live else "") + line, end=end, file=sys.stderr, flush=True)
