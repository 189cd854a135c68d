"""Writes `vetted.toml`: which meshes and textures of the Debian packages are fit, and which pool owns them.

    python3 -m models.render.vetting

Meshes go by category of the furniture catalogue, textures by package. Green's sign of each normal map is the one that
makes its slopes more nearly the gradient of some height (less curl); where that is not clear, its folder's majority.
"""

import hashlib
import re
import zipfile
from collections import Counter
from pathlib import Path

import numpy as np

from .assets import PACKAGES, content, mesh, picture, slopes

TRAIN_CATEGORIES = {"Living room", "Bedroom", "Office", "Miscellaneous"}
LARGEST_OBJ = 1_500_000  # bytes; larger ones take too long to read
# leaves drawn on cards, which without their pictures are loose cards
UNFIT_SHAPES = (
    r"tree|plant|flower|bush|palm|grass|leaf|bamboo|ivy|hedge|fern|cactus|vine|conifer|weed|greens|cypress|orchid|arrow|text"
)
CROWDED = r"switch|plug|socket|antenna|rj-?45"  # dozens of nearly equal wall plates
# furniture is for training; doors and windows are boxes
UNFIT_FOR_OTHER = r"chair|stool|desk|sofa|couch|shel[fv]|cabinet|cupboard|bench|table|window|door"
# lamps and windows (which would have to shine or let light through), letters, plain gradients
UNFIT_TEXTURES = (
    r"light|lamp|glass|glow|sign|sky|door|comp|screen|grate|cloud|water|jump|portal|blend|test|logo|arrow|bar|_g\.|white|"
    r"crystal|switch|concrete[ako]|concretesigma|clear\d"
)
CLEAR = 1.1  # least ratio of the two curls


def shapes():
    """Rows [place, family] of each pool, no mesh twice."""
    rows, seen = {"train": [], "other": []}, set()
    for place, family, pool in _candidates():
        unfit = f"{UNFIT_SHAPES}|{CROWDED if pool == 'train' else UNFIT_FOR_OTHER}"
        if re.search(unfit, place.lower().split(":")[1]) or len(content(place)) > LARGEST_OBJ:
            continue
        try:
            vertices, faces = mesh(place)
        except (ValueError, IndexError):
            continue  # no faces, or a corner that is not there
        sides = np.sort(np.ptp(vertices, axis=0))
        key = (len(vertices), len(faces), round(float(np.abs(vertices).sum()), 2))
        if 40 <= len(faces) <= 60_000 and sides[0] > 0.03 and sides[1] > 0.12 and key not in seen:
            seen.add(key)
            rows[pool].append([place, family])
    return rows


def _candidates():
    for archive in sorted(Path(PACKAGES["sweethome3d-furniture"]).glob("*.sh3f")):
        text = zipfile.ZipFile(archive).read("PluginFurnitureCatalog.properties").decode("latin-1")
        value = lambda key: dict(re.findall(rf"^{key}#(\d+)\s*=\s*(.*?)\s*$", text, re.M))
        category, turned = value("category"), value("modelRotation")
        for n, path in value("model").items():
            if n not in turned and path.endswith(".obj"):  # turned models do not stand upright as stored
                pool = "train" if category[n] in TRAIN_CATEGORIES else "other"
                yield f"sweethome3d-furniture:{archive.name}{path}", f"sweethome3d {category[n].lower()}", pool
    root = Path(PACKAGES["redeclipse-data"])
    for path in sorted(root.rglob("*.obj")):
        yield f"redeclipse-data:{path.relative_to(root)}", f"redeclipse {path.relative_to(root).parts[0]}", "other"


def textures():
    """Rows [albedo's place, normal's name or "", specular's name or "", sign of green] of each pool, no picture twice."""
    rows, seen = {"train": [], "other": []}, set()
    for pool, listed in (("train", _terrain()), ("other", _walls())):
        for albedo, normal, specular in sorted(listed):
            if re.search(UNFIT_TEXTURES, albedo.lower().rsplit("/", 1)[1]) or _plain(albedo, seen):
                continue
            specular = specular if specular and picture(specular).std() > 4 else ""
            if pool == "train" or specular:
                name = lambda place: place.rsplit("/", 1)[-1]
                rows[pool].append([albedo, name(normal), name(specular), _green(normal) if normal else 0.0])
        folder = lambda row: row[0].rsplit("/", 1)[0]
        votes = Counter()
        for row in rows[pool]:
            votes[folder(row)] += np.sign(row[3])
        for row in rows[pool]:
            clear = abs(row[3]) > np.log(CLEAR) or not row[1]
            row[3] = int(np.sign(row[3])) if clear else int(np.sign(votes[folder(row)]) or -1)
    return rows


def _terrain():
    """Ground pictures of 0 A.D."""
    start = "art/textures/terrain/types/"
    names = [n for n in zipfile.ZipFile(PACKAGES["0ad-data"]).namelist() if n.startswith(start) and n.endswith(".dds")]
    by_stem = {}
    for name in names:
        by_stem.setdefault(name.split(".", 1)[0], f"0ad-data:{name}")
    for stem, place in by_stem.items():
        if not re.search(r"_(norm|spec|ao|height)(_|$)", stem):
            yield place, by_stem.get(f"{stem}_norm", ""), by_stem.get(f"{stem}_spec", "")


def _walls():
    """Wall and floor pictures of Red Eclipse that have a normal and a specular map."""
    root = Path(PACKAGES["redeclipse-data"])
    folders = ("wicked", "trak/trak4", "trak/trak5", "trak/trak6", "trak/trak7", "philipk/pk01", "philipk/pk02", "unnamed",
               "jojo", "luckystrike", "torley/desat", "misc", "appleflap", "jwin")
    for folder in folders:
        paths = {p.stem: f"redeclipse-data:{p.relative_to(root)}" for p in sorted((root / folder).glob("*.[jp][pn]g"))}
        for stem, place in paths.items():
            if re.search(r"(_(n|nm|s|z|g|i|gloss|local|add)|(?<=\d)[nsz])$", stem):
                continue
            # a color variant, told apart by a last letter, shares the maps of its series
            stems = [re.sub(r"(_[cd]|d)$", "", stem), re.sub(r"([-_]?[a-h])?(_[cd])?$", "", stem), stem]
            found = lambda ends: next((paths[s + e] for s in stems for e in ends if s + e in paths), "")
            normal, specular = found(("_n", "_nm", "n")), found(("_s", "_gloss", "s"))
            if normal and specular and place not in (normal, specular):
                yield place, normal, specular


def _plain(place, seen):
    """Whether a picture is too small, nearly one color, or had already."""
    image = picture(place)
    digest = hashlib.blake2b(image.tobytes()).digest()
    again = digest in seen
    seen.add(digest)
    return again or min(image.shape[:2]) < 512 or image.std((0, 1)).max() < 4 or image[..., :3].mean() < 12


def _green(place):
    """Log ratio of the curls with green down and green up: positive if up (OpenGL) is the gradient of a height."""
    curl = lambda s: np.abs(np.gradient(s[..., 0], axis=0) - np.gradient(s[..., 1], axis=1)).mean() + 1e-9
    image = picture(place)
    return float(np.log(curl(slopes(image, -1)) / curl(slopes(image, 1))))


def main():
    lines = ["# Written by `python3 -m models.render.vetting`: what assets.py may draw from.",
             "# shapes: [package:path, family]",
             "# textures: [package:path of albedo, names of the normal and specular map beside it, sign of green]"]
    found = {"shapes": shapes(), "textures": textures()}
    for pool in ("train", "other"):
        lines.append(f"\n[{pool}]")
        for kind in ("shapes", "textures"):
            quoted = lambda row: ", ".join(f'"{v}"' if isinstance(v, str) else str(v) for v in row)
            lines += [f"{kind} = ["] + [f"  [{quoted(row)}]," for row in found[kind][pool]] + ["]"]
            print(pool, kind, len(found[kind][pool]), Counter(row[3] for row in found[kind][pool]) if kind == "textures" else "")
    Path(__file__).with_name("vetted.toml").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
