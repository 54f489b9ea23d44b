"""A copy of a robot's map and the rules that keep it synchronized: SPEC.md, sections 8 and 9.

Nothing here knows of the network or of clocks but for the time that is passed in. What has to be asked for
is asked by `MapCopy.healing`, a generator that yields questions and is sent their answers.
"""

import math
import struct
from array import array
from collections import Counter, deque
from typing import NamedTuple

from tiles import CELLS, SIDE, UNKNOWN, NoBase, decode_band, root_digest, tile_digest
from wire import LAYER_NAMES, Header, Malformed

MAX_TILES = 16384  # of all layers together; 128 MiB
MAX_PARTIAL = 64  # incomplete tiles of one layer
MAX_RETIRED_BOOTS = 64
MAX_TILE_KEYS = 4096
FIRST_BACKOFF_S, LONGEST_BACKOFF_S = 0.5, 8.0

At = tuple[int, int]  # column and row of a tile


class Tile(NamedTuple):
    revision: int
    digest: bytes
    codes: array | None  # None: a tombstone


class Partial(NamedTuple):
    """A tile of which some rows have come."""

    revision: int
    check: bytes
    rows: dict[int, array]


class Request(NamedTuple):
    """A question to `map/LAYER/WHAT`; it is answered with a list of bodies, empty if nothing came."""

    layer: str
    what: str
    body: dict


class Backoff:
    """When to ask again: after 0.5 s, then after twice as long each time, up to 8 s."""

    def __init__(self):
        self.until, self.next_s = -math.inf, FIRST_BACKOFF_S

    def failed(self, now: float):
        self.until, self.next_s = now + self.next_s, min(2 * self.next_s, LONGEST_BACKOFF_S)


class Layer:
    def __init__(self, name: str):
        self.name, self.cell_m = name, None
        self.backoff = Backoff()
        self.clear(0)

    def clear(self, epoch: int):
        """Begins the epoch with no tile."""
        self.epoch = epoch
        self.tiles: dict[At, Tile] = {}
        self.partial: dict[At, Partial] = {}
        self.head = None  # the newest LayerHead of this epoch
        self.mismatched_heads = 0  # heads, one after the other, that differed from what was held
        self.newer_than = 0  # what digests need not be asked for again
        self._root = None

    def root(self) -> bytes:
        if self._root is None:
            digests = {at: tile.digest for at, tile in self.tiles.items()}
            self._root = root_digest(self.name, self.cell_m, digests)
        return self._root

    def is_synchronized(self) -> bool:
        return self.head is not None and self.cell_m is not None and self.head["root"] == self.root()

    def revision(self, at: At) -> int:
        return self.tiles[at].revision if at in self.tiles else 0

    def known_cells(self) -> int:
        return sum(CELLS - tile.codes.count(0) for tile in self.tiles.values() if tile.codes)

    def enter(self, epoch: int) -> bool:
        """Goes on to a newer epoch, wherever it came from; False for an older one, which is void."""
        if epoch > self.epoch:
            self.clear(epoch)
        return epoch == self.epoch

    def hold(self, at: At, tile: Tile):
        self.tiles[at] = tile
        if at in self.partial and self.partial[at].revision <= tile.revision:
            del self.partial[at]
        self._root = None

    def drop(self, at: At):
        del self.tiles[at]
        self._root = None

    def collect(self, at: At, band: dict) -> Tile | None:
        """Takes one band; the tile, if all of its rows are there now. Raises `Malformed`."""
        if band["epoch"] < self.epoch or (band["epoch"] == self.epoch and band["revision"] <= self.revision(at)):
            return None
        held = self.tiles.get(at) if band["epoch"] == self.epoch else None
        base = None
        if held and held.revision == band["base"]:
            base = held.codes or array("H", bytes(2 * CELLS))
        first, codes = decode_band(band["rows"], self.name, base)
        self.enter(band["epoch"])
        partial = self.partial.get(at)
        if partial and partial.revision > band["revision"]:
            return None
        # One revision has one check. If two come all the same, the later one is collected: the
        # first may have been damaged, and waiting for its other rows would keep the right one out.
        if not partial or (partial.revision, partial.check) != (band["revision"], band["check"]):
            self.partial.pop(at, None)
            if len(self.partial) >= MAX_PARTIAL:
                del self.partial[next(iter(self.partial))]  # the oldest
            partial = self.partial[at] = Partial(band["revision"], band["check"], {})
        for i in range(len(codes) // SIDE):
            partial.rows.setdefault(first + i, codes[i * SIDE : (i + 1) * SIDE])
        if len(partial.rows) < SIDE:
            return None
        del self.partial[at]
        whole = array("H")
        for y in range(SIDE):
            whole.extend(partial.rows[y])
        digest = tile_digest(whole)
        if digest[:8] != partial.check:
            raise Malformed(f"{self.name} tile {at}: digest does not match its cells")
        return Tile(partial.revision, digest, None if digest == UNKNOWN else whole)

    def compare(self, answer: dict, newer_than: int) -> dict[At, int]:
        """Rule 5, steps 2 and 3: puts right what a complete answer can, and says what is missing."""
        listed = {(tile["tx"], tile["ty"]): tile for tile in answer["tiles"]}
        if newer_than == 0:
            for at in [at for at, tile in self.tiles.items() if tile.revision <= answer["head_revision"]]:
                if at not in listed:
                    self.drop(at)
        missing = {}
        for at, said in listed.items():
            held = self.tiles.get(at)
            if held and held.digest == said["digest"]:
                if said["revision"] > held.revision:
                    self.hold(at, held._replace(revision=said["revision"]))
                continue
            if held and held.revision == said["revision"]:
                self.drop(at)  # two states of one revision do not exist: one of the two is wrong
            if said["revision"] > self.revision(at):
                if said["digest"] == UNKNOWN:
                    self.hold(at, Tile(said["revision"], UNKNOWN, None))
                else:
                    missing[at] = said["revision"]
        return missing


class MapCopy:
    """All layers of one robot, of its present boot."""

    def __init__(self):
        self.counts = Counter()  # what was dropped, by reason
        self.retired_boots = deque(maxlen=MAX_RETIRED_BOOTS)
        self.begin(None)

    def begin(self, boot: bytes | None):
        """Forgets all of the boot before."""
        self.boot = boot
        self.info = None
        self.head_header: Header | None = None  # of the newest MapHead
        self.is_full = False
        self.position = (0.0, 0.0)
        self.layers = {name: Layer(name) for name in LAYER_NAMES}

    def mapped(self) -> list[Layer]:
        """The layers that the robot says it maps."""
        return [layer for layer in self.layers.values() if layer.cell_m is not None]

    def is_synchronized(self) -> bool:
        return bool(self.mapped()) and all(layer.is_synchronized() for layer in self.mapped())

    def newest_revision(self) -> int:
        return max((tile.revision for layer in self.mapped() for tile in layer.tiles.values()), default=0)

    def is_current_boot(self, header: Header) -> bool:
        if header.boot == self.boot:
            return True
        self.counts["of another boot"] += 1
        return False

    def take_info(self, header: Header, info: dict) -> bool:
        if self.boot is None:
            self.begin(header.boot)
        if not self.is_current_boot(header):
            return False
        if not all(0 < layer["cell_m"] < math.inf for layer in info["layers"]):
            raise Malformed("cells of no size")
        self.info = info
        for layer in info["layers"]:
            self.layers[layer["layer"]].cell_m = layer["cell_m"]
        return True

    def take_head(self, header: Header, head: dict) -> bool:
        """True if the head is that of a new boot, so that `info` has to be asked for again."""
        if header.boot in self.retired_boots:
            self.is_current_boot(header)
            return False
        is_new = header.boot != self.boot
        if is_new:
            if self.boot is not None:
                self.retired_boots.append(self.boot)
            self.begin(header.boot)
        if self.head_header is None or header.seq > self.head_header.seq:
            self.head_header = header
            for said in head["layers"]:
                layer = self.layers[said["layer"]]
                if layer.enter(said["epoch"]):
                    layer.head = said
                    layer.mismatched_heads = 0 if layer.is_synchronized() else layer.mismatched_heads + 1
        return is_new

    def take_band(self, layer: str, at: At, band: dict):
        """A band of the present boot, pushed or asked for. Raises `Malformed`."""
        layer = self.layers[layer]
        try:
            tile = layer.collect(at, band)
        except NoBase:
            self.counts["differences to a tile that was missed"] += 1
            layer.mismatched_heads = 2  # heal without waiting for a head
            return
        if tile:
            if at not in layer.tiles and sum(len(l.tiles) for l in self.layers.values()) >= MAX_TILES:
                self.is_full = True
                self.counts["tiles without space"] += 1
            else:
                layer.hold(at, tile)

    def healing(self, clock):
        """Rule 5, for ever. Yields a `Request`, or None if there is nothing to ask for now."""
        while True:
            for layer in self.mapped():
                apart = layer.mismatched_heads >= 2 or (layer.mismatched_heads >= 1 and not layer.tiles)
                if apart and not layer.is_synchronized() and clock() >= layer.backoff.until and not self.is_full:
                    yield from self._heal(layer, clock)
            yield None

    def _heal(self, layer: Layer, clock):
        newer_than = layer.newer_than
        answer = yield from self._list(layer, newer_than)
        if answer is None or not layer.enter(answer["epoch"]):
            return layer.backoff.failed(clock())
        missing = layer.compare(answer, newer_than)
        while missing:
            these = sorted(missing, key=lambda at: self._distance(layer, at))[:MAX_TILE_KEYS]
            before = len(missing)
            for reply in (yield Request(layer.name, "tiles", {"ByKey": [list(at) for at in these]})):
                try:
                    self.take_band(layer.name, (reply["tx"], reply["ty"]), reply["band"])
                except Malformed:
                    self.counts["malformed"] += 1
            if layer.epoch != answer["epoch"] or self.is_full:
                return None
            missing = {at: revision for at, revision in missing.items() if layer.revision(at) < revision}
            if len(missing) == before:
                return layer.backoff.failed(clock())
        layer.backoff = Backoff()
        layer.newer_than = answer["head_revision"] if layer.is_synchronized() else 0
        layer.mismatched_heads = 1  # if it is a step behind already, the next head will say so

    def _list(self, layer: Layer, newer_than: int):
        """All pages of the list of tiles newer than a revision, as one answer; None if one is missing."""
        pages = []
        while True:
            page = one_page((yield Request(layer.name, "digests", {"newer_than": newer_than})))
            if page is None or (pages and page["epoch"] != pages[0]["epoch"]):
                return None
            pages.append(page)
            if not page["more"]:
                return page | {"tiles": [tile for page in pages for tile in page["tiles"]]}
            newer_than = page["tiles"][-1]["revision"]

    def _distance(self, layer: Layer, at: At) -> float:
        side = SIDE * layer.cell_m
        return math.dist(((at[0] + 0.5) * side, (at[1] + 0.5) * side), self.position)


def one_page(replies: list[dict]) -> dict | None:
    """The one reply of an answer, or None if there is not one, or one that leads nowhere."""
    if len(replies) != 1 or (replies[0]["more"] and not replies[0]["tiles"]):
        return None
    return replies[0]


def dequantise(code: int) -> float:
    """The probability that a code of `occupancy` stands for, as the nearest f32; NaN for unknown."""
    return struct.unpack("<f", struct.pack("<f", (code - 1) / 250))[0] if code else math.nan
