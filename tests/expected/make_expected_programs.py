#!/usr/bin/env python3
"""Writes the expected contents of MATLAB, MINFLUX, SMLM, ASDF, Insight3 and TrackMate files.

    python make_expected_programs.py DATA [OUT]

They are read with NumPy, SciPy, the asdf package and Python's own zip, JSON and XML only. Arguments and
results are those of make_expected.py.
"""

import io
import json
import sys
import xml.etree.ElementTree as ElementTree
import zipfile
from pathlib import Path

import asdf
import numpy
import scipy.io

from make_expected import summary, table, write

MATLAB = ["smap/sampledata_npc.mat", "spot-on/anders.mat", "spot-on/utrack.mat"]
MINFLUX = [
    "pyminflux/2D_ValidOnly.npy.zip",
    "pyminflux/3D_ValidOnly.npy.zip",
    "pyminflux/two_fluorophores_assignment.npy",
    "rfrc4minflux/nup96.json",
]
SMLM = ["locan/SMLM_dstorm_data.smlm"]
ASDF = [
    "locan/clathrin_3d.asdf",
    "locan/npc_gp210.asdf",
    "locan/rapidSTORM_beads_green.asdf",
    "locan/rapidSTORM_beads_red.asdf",
]
INSIGHT3 = ["storm-analysis/test_300x200_dh_olist.bin", "storm-analysis/test_olist.bin"]
TRACKMATE = ["pytrackmate/FakeTracks.xml", "spot-on/TrackMate.xml"]

# Names of locan, and of Insight3 in the order of its records with (float, our name, our unit).
LOCAN_NAMES = {
    "position_x": ("x", "unknown"),
    "position_y": ("y", "unknown"),
    "position_z": ("z", "unknown"),
    "frame": ("t", "frame"),
    "original_index": ("original_index", "1"),
}
INSIGHT3_NAMES = [
    ("x", True, "x_raw", "unknown"),
    ("y", True, "y_raw", "unknown"),
    ("xc", True, "x", "unknown"),
    ("yc", True, "y", "unknown"),
    ("h", True, "height", None),
    ("a", True, "A", None),
    ("w", True, "width", "nm"),
    ("phi", True, "phi", None),
    ("ax", True, "aspect", "1"),
    ("bg", True, "background", None),
    ("i", True, "intensity", None),
    ("c", False, "category", "1"),
    ("fi", False, "fit_status", "1"),
    ("fr", False, "t", "frame"),
    ("tl", False, "track_length", "frame"),
    ("lk", False, "link", "1"),
    ("z", True, "z_raw", "nm"),
    ("zc", True, "z", "nm"),
]
MINFLUX_UNITS = {"tim": ("t", "s"), "tid": ("clumpIndex", "1"), "eco": ("eco", "photon"), "efo": ("efo", "1/s")}


def column(source, values, name=None, unit=None, factor=1.0, offset=0.0):
    values = numpy.asarray(values).ravel()
    kind = {"f": "f", "i": "i", "u": "u", "b": "bool"}[values.dtype.kind]
    stored = kind if kind == "bool" else kind + str(8 * values.dtype.itemsize)
    entry = {"source": source, "name": name or source, "unit": unit, "type": stored}
    return entry | summary([float(value) for value in values], factor=factor, offset=offset)


def matlab(path):
    content = scipy.io.loadmat(path)
    if "trackedPar" in content:
        tracks = content["trackedPar"].ravel()
        places = numpy.concatenate([track["xy"] for track in tracks])
        frames = numpy.concatenate([track["Frame"].ravel() for track in tracks]).astype(float)
        times = numpy.concatenate([track["TimeStamp"].ravel() for track in tracks])
        number = numpy.repeat(numpy.arange(len(tracks)), [track["Frame"].size for track in tracks])
        return [
            table(
                "localisations",
                len(frames),
                [
                    column("xy", places[:, 0], "x", "nm", 1e3),
                    column("xy", places[:, 1], "y", "nm", 1e3),
                    column("Frame", frames, "t", "frame", 1.0, -1.0),
                    column("TimeStamp", times, "time", "s"),
                    column("", number, "track", "1"),
                ],
            )
        ]
    if "tracksFinal" in content:
        rows, frames, tracks = [], [], []
        for number, one in enumerate(content["tracksFinal"].ravel()):
            # No track of the file merges or splits: one segment each.
            values = one["tracksCoordAmpCG"].reshape(-1, 8)
            present = ~numpy.isnan(values[:, 0])
            first = one["seqOfEvents"][:, 0].min() - 1
            rows.append(values[present])
            frames.append(first + numpy.arange(len(values))[present])
            tracks.append(numpy.full(present.sum(), number))
        rows = numpy.concatenate(rows)
        names = ["x", "y", "z", "A", "error_x", "error_y", "error_z", "error_A"]
        columns = [column(name, rows[:, i], name, "unknown") for i, name in enumerate(names)]
        columns.append(column("", numpy.concatenate(frames), "t", "frame"))
        columns.append(column("", numpy.concatenate(tracks), "track", "1"))
        return [table("localisations", len(rows), columns)]
    data = content["data"][0, 0]
    columns = [column(name, data[name], name, "unknown") for name in "xyt"]
    return [table("localisations", data["x"].size, columns)]


def minflux(path):
    if path.suffix == ".json":
        rows = json.loads(path.read_text(encoding="utf-8"))
        places = numpy.array([row["loc"] for row in rows])
        columns = [column(f"loc[{i}]", places[:, i], "xy"[i], "nm", 1e9) for i in range(2)]
        for source, (name, unit) in MINFLUX_UNITS.items():
            columns.append(column(source, [row[source] for row in rows], name, unit))
        return [table("localisations", len(rows), columns)]
    if path.suffix == ".zip":
        with zipfile.ZipFile(path) as archive:
            (inner,) = [name for name in archive.namelist() if name.endswith(".npy")]
            array = numpy.load(io.BytesIO(archive.read(inner)), allow_pickle=False)
    else:
        array = numpy.load(path, allow_pickle=False)
    if not array.dtype.names:
        return [table("localisations", len(array), [column("value", array, "value", "unknown")])]
    array = array[array["vld"]]
    last = array["itr"][:, -1]
    columns = [column(f"loc[{i}]", last["loc"][:, i], "xyz"[i], "nm", 1e9) for i in range(3)]
    columns += [column(source, array[source], *MINFLUX_UNITS[source]) for source in ["tim", "tid"]]
    columns += [column(source, last[source], *MINFLUX_UNITS[source]) for source in ["eco", "efo"]]
    columns += [column("dcr", last["dcr"], "dcr", "1"), column("dmz", last["dmz"], "dmz", "nm", 1e9)]
    return [table("localisations", len(array), columns)]


def locan(source, values, units=()):
    name, unit = LOCAN_NAMES.get(source, (source, None))
    return column(source, values, name, dict(units).get(source, unit))


def smlm(path):
    with zipfile.ZipFile(path) as archive:
        manifest = json.loads(archive.read("manifest.json"))
        (file,) = manifest["files"]
        described = manifest["formats"][file["format"]]
        record = numpy.dtype(
            [
                (header, numpy.dtype(kind).newbyteorder("<"))
                for header, kind in zip(described["headers"], described["dtype"])
            ]
        )
        records = numpy.frombuffer(archive.read(file["name"]), record, int(file["rows"]))
    units = [(unit["property"], unit["unit"]) for unit in manifest["locdata_meta"]["unit"]]
    columns = [locan(name, records[name], units) for name in record.names]
    return [table("localisations", len(records), columns)]


def asdf_file(path):
    with asdf.open(path) as file:
        data = numpy.array(file["data"])
        columns = [locan(name, data[:, i]) for i, name in enumerate(file["columns"])]
    return [table("localisations", len(data), columns)]


def insight3(path):
    content = path.read_bytes()
    record = numpy.dtype([(name, "<f4" if real else "<i4") for name, real, _, _ in INSIGHT3_NAMES])
    count = int.from_bytes(content[12:16], "little")
    records = numpy.frombuffer(content, record, count, 16)
    columns = [
        column(source, records[source], name, unit, 1.0, -1.0 if source == "fr" else 0.0)
        for source, _, name, unit in INSIGHT3_NAMES
    ]
    return [table("localisations", count, columns)]


def trackmate(path):
    root = ElementTree.parse(path).getroot()
    if root.tag == "Tracks":
        particles = root.findall("particle")
        spots = [spot for particle in particles for spot in particle.findall("detection")]
        number = [i for i, particle in enumerate(particles) for _ in particle.findall("detection")]
        columns = [
            column(axis, [float(spot.get(axis)) for spot in spots], axis, "nm", 1e3) for axis in "xyz"
        ]
        columns.append(column("t", [int(spot.get("t")) for spot in spots], "t", "frame"))
        columns.append(column("", number, "track", "1"))
        return [table("localisations", len(spots), columns)]
    spots = list(root.iter("Spot"))
    track = {}
    for one in root.iter("Track"):
        for edge in one.findall("Edge"):
            for end in ["SPOT_SOURCE_ID", "SPOT_TARGET_ID"]:
                track[edge.get(end)] = int(one.get("TRACK_ID"))

    def numbers(source):
        return [float(spot.get(source)) for spot in spots]

    columns = [
        column(f"POSITION_{axis.upper()}", numbers(f"POSITION_{axis.upper()}"), axis, "unknown")
        for axis in "xyz"
    ]
    columns.append(column("POSITION_T", numbers("POSITION_T"), "time", "s"))
    columns.append(column("FRAME", numbers("FRAME"), "t", "frame"))
    columns.append(column("QUALITY", numbers("QUALITY"), "quality", None))
    columns.append(column("RADIUS", numbers("RADIUS"), "radius", "unknown"))
    columns.append(column("VISIBILITY", numbers("VISIBILITY"), "visibility", "1"))
    columns.append(column("", [track.get(spot.get("ID"), -1) for spot in spots], "track", "1"))
    return [table("localisations", len(spots), columns)]


def main(arguments):
    if len(arguments) not in (1, 2):
        print(__doc__.strip(), file=sys.stderr)
        return 2
    data = Path(arguments[0])
    out = Path(arguments[1]) if len(arguments) == 2 else Path(__file__).parent
    write(out, data, "matlab", matlab, MATLAB)
    write(out, data, "minflux", minflux, MINFLUX)
    write(out, data, "smlm", smlm, SMLM)
    write(out, data, "asdf", asdf_file, ASDF)
    write(out, data, "insight3", insight3, INSIGHT3)
    write(out, data, "trackmate", trackmate, TRACKMATE)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
