"""What the name of a part says of it: words of five languages, and standards."""

from __future__ import annotations

import re
import unicodedata

from dolfinx_frontend.geometry.threads import SIZES, Size

__all__ = ["named_kind", "named_size"]

_WORDS: dict[str, tuple[str, ...]] = {
    "washer": ("washer", "scheibe", "rondelle", "arandela", "rondella", "rosetta"),
    "nut": ("nut", "mutter", "ecrou", "tuerca", "dado"),
    "stud": ("stud", "stehbolzen", "stiftschraube", "gewindebolzen", "gewindestange", "goujon", "esparrago",
             "prigioniero", "threaded rod", "tige filetee", "barra roscada", "barra filettata"),
    "dowel": ("dowel", "zylinderstift", "passstift", "goupille", "pasador", "spina", "parallel pin"),
    "bolt": ("bolt", "screw", "schraube", "vis", "boulon", "tornillo", "perno", "vite", "bullone"),
    "gasket": ("gasket", "seal", "rubber", "gummi[a-z]*", "caoutchouc", "goma", "gomma", "dichtung", "joint",
               "junta", "guarnizione"),
    "sheet": ("shim", "sheet", "blech", "tole", "chapa", "lamiera"),
}
"""Kind -> words, the special ones before those that they contain. They may end a longer word
(Sechskantschraube) and be in the plural; English, German, French, Spanish, Italian."""

_STANDARDS: dict[str, tuple[str, ...]] = {
    "washer": ("iso 7089", "iso 7090", "iso 7091", "iso 7092", "iso 7093", "iso 7094", "din 125", "din 126",
               "din 433", "din 440", "din 6796", "din 6916", "din 9021", "din 127"),
    "nut": ("iso 4032", "iso 4033", "iso 4034", "iso 4035", "iso 7040", "iso 7042", "iso 10511", "din 934",
            "din 936", "din 439", "din 985", "din 6923"),
    "stud": ("din 835", "din 938", "din 939", "din 940", "din 975", "din 976", "din 2509", "din 2510"),
    "dowel": ("iso 2338", "iso 8734", "iso 8735", "din 6325", "din 7979"),
    "bolt": ("iso 4014", "iso 4016", "iso 4017", "iso 4018", "iso 4762", "iso 7380", "iso 10642", "iso 8765",
             "iso 8676", "iso 1207", "iso 7984", "din 912", "din 931", "din 933",
             "din 960", "din 961", "din 6912",
             "din 7984", "din 7991", "din 6921", "din 84"),
    "gasket": ("en 1514", "iso 7483", "din 2690"),
}

_THREAD = re.compile(r"(?<![a-z])m ?(\d{1,2})(?![\d])(?:(?:[ x*]|$)|\D)")


def _plain(name: str) -> str:
    """In lower case and without accents; what is no letter or digit is a space."""
    text = unicodedata.normalize("NFKD", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name))
    text = "".join(c for c in text if not unicodedata.combining(c)).lower()
    return re.sub(r"[^a-z0-9]+", " ", re.sub(r"(?<=[a-z])(?=\d{2})|(?<=\d)(?=[a-wyz])", " ", text)).strip()


def named_kind(name: str) -> str:
    """What a name says that a part is; empty: nothing."""
    text = _plain(name)
    for kind, standards in _STANDARDS.items():
        if any(re.search(rf"\b{each}\b", text) for each in standards):
            return kind
    for kind, words in _WORDS.items():
        # a short word is one by itself: "vis" is in "television", "nut" in "minute"
        for word in words:
            front = r"\b" if len(word) < 5 else ""
            if re.search(rf"{front}{word}(?:e?s|n|en)?\b", text):
                return kind
    return ""


def named_size(name: str) -> Size | None:
    """The thread that a name has, as in ``M12x40``; None: none."""
    found = _THREAD.search(_plain(name))
    return SIZES.get(f"M{found[1]}") if found else None
