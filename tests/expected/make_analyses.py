#!/usr/bin/env python3
"""Writes what scipy and scikit-learn make of real localisations.

    python make_analyses.py DATA [OUT]

DATA is the folder of the data files, OUT the written file (default: analyses.json beside this script).
Nothing of this project's own code takes part. The README beside this script describes the fields.
"""

import hashlib
import json
import sys
from pathlib import Path

import h5py
import numpy
import pandas
from scipy.spatial import ConvexHull, cKDTree
from sklearn.cluster import DBSCAN

FORMAT = "puncta.expected-analyses/1"
SETTINGS = [(20, 5), (50, 10), (100, 20)]
RADII = [10.0, 20.0, 50.0, 100.0, 200.0, 500.0]
STEP = 10.0

PLANE = ["x [nm]", "y [nm]"]
# File, columns of the positions in nm, what a reader must be told.
TEXT = [
    ("pyme-smlm-import-tests/ThunderSTORM_TS3D.csv", PLANE, {}),
    ("pyme-smlm-import-tests/ThunderSTORM_TS3D.csv", [*PLANE, "z [nm]"], {}),
    ("smolr/3d_localizations.csv", [*PLANE, "z [nm]"], {}),
    ("colicoords/01_storm.csv", PLANE, {}),
    ("smlm-clustering/Training_MEDIUM.csv", PLANE, {}),
    ("smlm-clustering/Training_EASY.csv", PLANE, {}),
    ("pyme-smlm-import-tests/CaulobacterC_2_R09_MoernerLab.csv", ["x", "y", "z"], {"units": "nm"}),
    (
        "mean-shift-drift/NPCdata_meanshift_example.csv",
        [0, 1],
        {"columns": "x,y,t", "units": "nm"},
    ),
]
H5R = ["pyme-extra-sample-data/1_2_series_D.h5r"]


def analyses(points):
    points = points[numpy.isfinite(points).all(1)]
    count, axes = points.shape
    tree = cKDTree(points)
    nearest = tree.query(points, k=2)[0][:, 1]
    hull = ConvexHull(points)
    low, high = points.min(0), points.max(0)
    found = {
        "axes": axes,
        "rows": count,
        "low": low.tolist(),
        "high": high.tolist(),
        "nearest_mean": nearest.mean(),
        "nearest_median": numpy.median(nearest),
        "hull_size": hull.volume,
        "hull_rim": hull.area,
        "dbscan": [dbscan(points, *setting) for setting in SETTINGS],
    }
    if axes == 2:
        area = numpy.prod(high - low)
        pairs = tree.count_neighbors(tree, RADII) - count
        found["l_minus_r"] = (
            numpy.sqrt(area * pairs / count / (count - 1) / numpy.pi) - RADII
        ).tolist()
        found["radii"] = RADII
        place = numpy.floor(points / STEP).astype(int)
        cells, held = numpy.unique(place, axis=0, return_counts=True)
        found["pixels"] = {"size": STEP, "set": len(cells), "most": int(held.max())}
    return found


def dbscan(points, eps, least):
    labels = DBSCAN(eps=eps, min_samples=least).fit(points)
    return {
        "eps": eps,
        "min_points": least,
        "clusters": int(labels.labels_.max()) + 1,
        "noise": int((labels.labels_ < 0).sum()),
        "core": len(labels.core_sample_indices_),
    }


def entry(data, file, reader, points):
    content = (data / file).read_bytes()
    return {
        "file": file,
        "sha256": hashlib.sha256(content).hexdigest(),
        "reader": reader,
    } | analyses(points)


def main(arguments):
    if len(arguments) not in (1, 2):
        print(__doc__.strip(), file=sys.stderr)
        return 2
    data = Path(arguments[0])
    out = Path(arguments[1]) if len(arguments) == 2 else Path(__file__).with_name("analyses.json")
    sets = []
    for file, names, reader in TEXT:
        table = pandas.read_csv(data / file, header=None if "columns" in reader else "infer")
        sets.append(entry(data, file, reader, table[names].to_numpy(dtype=float)))
    for file in H5R:
        with h5py.File(data / file) as opened:
            results = opened["FitResults"]["fitResults"]
        points = numpy.column_stack([results["x0"], results["y0"]]).astype(float)
        sets.append(entry(data, file, {}, points))
    lines = ",\n".join(json.dumps(one, allow_nan=False) for one in sets)
    text = f'{{"format": "{FORMAT}", "sets": [\n{lines}\n]}}\n'
    out.write_text(text, encoding="utf-8")
    print(f"{out}: {len(sets)} sets")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
