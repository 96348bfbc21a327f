#!/usr/bin/env python3
"""Writes the expected contents of files of many programs, read with pandas, h5py, ElementTree, tifffile and numpy only.

    python make_expected_formats.py DATA [OUT]

As make_expected.py, with one entry a format: what each program's columns are called here, their unit, and the factor and
the offset from the file's values. None of it is taken from this project's own code.
"""

import io
import json
import sys
import zipfile
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import h5py
import numpy
import pandas
import tifffile

from make_expected import entry, is_number, save, short_type, split_unit, summary, table, text_column, text_columns

# Source name without its unit -> our names, unit, factor, offset. Missing: the same name, unit unsaid.
FRAME = (["t"], "frame", 1.0, 0.0)
FRAME1 = (["t"], "frame", 1.0, -1.0)
PHOTONS = (["nPhotons"], "photon", 1.0, 0.0)
LATERAL = (["error_x", "error_y"], "nm", 1.0, 0.0)


def nm(*names, factor=1.0):
    return (list(names), "nm", factor, 0.0)


def one(name):
    return ([name], None, 1.0, 0.0)


LEB = {
    "x": nm("x"),
    "y": nm("y"),
    "z": nm("z"),
    "frame": FRAME,
    "uncertainty": LATERAL,
    "intensity": PHOTONS,
    "offset": (["background"], "photon", 1.0, 0.0),
    "sigma_x": nm("sigx"),
    "sigma_y": nm("sigy"),
}
TRACK = {"trajectory": one("track"), "Trajectory": one("track"), "TRACK_ID": one("track")}
TEXT = {
    "LEB": (["bstore/MT0.N1.LD-AS-Exp_Localizations.csv", "bstore/sequence-as-stack-Beads-AS-Exp_Localizations.csv"], LEB),
    "pyMINFLUX csv": (
        ["pyminflux/two_fluorophores_df.csv"],
        {
            "": one("index"),
            "tid": one("clumpIndex"),
            "tim": (["time"], "s", 1.0, 0.0),
            "x": nm("x"),
            "y": nm("y"),
            "z": nm("z"),
            "eco": PHOTONS,
            "dwell": (["dwell"], "s", 1e-3, 0.0),
            "fluo": one("probe"),
        },
    ),
    "saspt": (
        ["saspt/region_0_7ms_trajs.csv", "saspt/sample_tracks.csv"],
        TRACK | {"frame": FRAME, "I0": one("nPhotons"), "bg": one("background"), "x_err": one("error_x"), "y_err": one("error_y")},
    ),
    "MOSAIC": (["spot-on/MOSAIC.csv"], TRACK | {"": one("index"), "Frame": FRAME}),
    "TrackMate csv": (
        ["spot-on/TrackMate.csv"],
        TRACK
        | {
            "": one("index"),
            "FRAME": FRAME,
            "POSITION_X": one("x"),
            "POSITION_Y": one("y"),
            "POSITION_Z": one("z"),
            "POSITION_T": one("time"),
        },
    ),
    "Spot-On": (
        ["spot-on/standard_csv.csv"],
        TRACK | {"": one("index"), "frame": FRAME, "t": (["time"], "s", 1.0, 0.0), "x": nm("x", factor=1e3), "y": nm("y", factor=1e3)},
    ),
    "SMLM challenge": (
        ["thunderstorm/tubulins1_00020.csv"],
        {"Ground-truth": one("ground_truth"), "frame": FRAME1, "xnano": nm("x"), "ynano": nm("y"), "znano": nm("z")},
    ),
    "ONI Nanoimager": (
        ["locan/Nanoimager_dstorm_data.csv"],
        {
            "Channel": one("probe"),
            "Frame": FRAME,
            "X": nm("x"),
            "Y": nm("y"),
            "Z": nm("z"),
            "Photons": PHOTONS,
            "Background": (["background"], "photon", 1.0, 0.0),
        },
    ),
}
ELYRA = {
    "Index": one("Index"),
    "First Frame": FRAME1,
    "Position X": nm("x"),
    "Position Y": nm("y"),
    "Precision": LATERAL,
    "Number Photons": PHOTONS,
    "PSF half width": nm("psf_half_width"),
    "Channel": one("probe"),
}
RAPIDSTORM = {
    "Position-0-0": nm("x"),
    "Position-1-0": nm("y"),
    "Position-0-0-uncertainty": nm("error_x"),
    "Position-1-0-uncertainty": nm("error_y"),
    "ImageNumber-0-0": FRAME,
    "Amplitude-0-0": (["A"], "ADU", 1.0, 0.0),
    "PSFWidth-0-0": nm("fwhm_x"),
    "PSFWidth-1-0": nm("fwhm_y"),
    "FitResidues-0-0": one("fit_residues"),
    "LocalBackground-0-0": (["background"], "ADU", 1.0, 0.0),
}
# Without a header: file -> reader's options, and our name, unit, factor and offset of each column.
HEADERLESS = {
    "spot-on/evalSPT.txt": (
        {"dialect": "evalspt"},
        [nm("x", factor=1e3), nm("y", factor=1e3), FRAME1, one("track")] + [one(f"column_{k}") for k in range(5, 9)],
    ),
    "tramway/trajectories.txt": (
        {"dialect": "trxyt"},
        [one("index"), one("track"), nm("x", factor=1e3), nm("y", factor=1e3), (["time"], "s", 1.0, 0.0)],
    ),
    "mean-shift-drift/NPCdata_meanshift_example.csv": (
        {"columns": "x [nm],y [nm],t"},
        [nm("x"), nm("y"), one("t")],
    ),
    "frc-resolution/TestData01.txt": ({"columns": "x,y", "units": "px", "pixel_size": 100}, [nm("x", factor=100.0), nm("y", factor=100.0)]),
    "storm-analysis/test_drift.txt": ({}, [one(f"column_{k}") for k in range(1, 5)]),
    "storm-analysis/test_olist.txt": ({}, [one(f"column_{k}") for k in range(1, 5)]),
    "smlmsurfacereconstruction/ptsOut20200618.xyz": ({"columns": "x,y,z", "units": "nm"}, [nm("x"), nm("y"), nm("z")]),
}
SMAP = {
    "xnm": nm("x"),
    "ynm": nm("y"),
    "znm": nm("z"),
    "frame": FRAME1,
    "phot": PHOTONS,
    "bg": (["background"], "photon", 1.0, 0.0),
    "locprecnm": LATERAL,
    "locprecznm": nm("error_z"),
    "PSFxnm": nm("sigx"),
    "PSFynm": nm("sigy"),
}
MINFLUX = {
    "tid": one("clumpIndex"),
    "tim": (["time"], "s", 1.0, 0.0),
    "x": nm("x"),
    "y": nm("y"),
    "z": nm("z"),
    "eco": PHOTONS,
    "dwell": (["dwell"], "s", 1e-3, 0.0),
    "fluo": one("probe"),
}


def column(source, values, rule, type_name="number"):
    names, unit, factor, offset = rule
    numbers = [float(value) for value in values]
    head = {"source": source, "unit": unit, "type": type_name}
    return [{**head, "name": name} | summary(numbers, factor, offset) for name in names]


def text(names):
    def read(path):
        sources, fields = text_columns(path)
        columns = []
        for source, values in zip(sources, fields):
            base, _ = split_unit(source)
            rule = names.get(base)
            if rule is None or not all(is_number(value) for value in values):
                name = rule[0][0] if rule else None
                columns.append(text_column(source, values, name, None))
            else:
                columns.extend(column(source, values, rule))
        return [table("localisations", len(fields[0]), columns)]

    return read


def elyra(path):
    rows = path.read_bytes().split(b"\0")[0].decode("latin-1")
    frame = pandas.read_csv(io.StringIO(rows.strip()), sep="\t")
    columns = []
    for source in frame.columns:
        rule = ELYRA.get(split_unit(source)[0], ([None], None, 1.0, 0.0))
        columns.extend(column(source, frame[source], rule))
    return [table("localisations", len(frame), columns)]


def rapidstorm(path):
    lines = path.read_text().splitlines()
    root = ElementTree.fromstring(lines[0].lstrip("# "))
    outer = [field.get("identifier") for field in root.findall("field")]
    nested = root.find("localizations")
    rows = [[float(value) for value in line.split()] for line in lines[1:] if line.strip()]
    columns = []
    if nested is None:
        for index, source in enumerate(outer):
            columns.extend(column(None, [row[index] for row in rows], RAPIDSTORM[source]))
        return [table("localisations", len(rows), columns)]
    inner = [field.get("identifier") for field in nested.findall("field")]
    flat, track = [], []
    for number, row in enumerate(rows):
        rest = row[len(outer) + 1 :]
        assert len(rest) == row[len(outer)] * len(inner)
        flat.extend(rest[at : at + len(inner)] for at in range(0, len(rest), len(inner)))
        track.extend([number] * int(row[len(outer)]))
    columns.extend(column(None, track, one("track")))
    for index, source in enumerate(inner):
        columns.extend(column(None, [row[index] for row in flat], RAPIDSTORM[source]))
    return [table("localisations", len(flat), columns)]


def headerless(rules):
    def read(path):
        separator = "," if path.suffix == ".csv" else r"\s+"
        frame = pandas.read_csv(path, sep=separator, header=None, engine="python", dtype=str)
        columns = []
        for index, rule in enumerate(rules):
            columns.extend(column(None, frame[index].map(float), rule))
        return [table("localisations", len(frame), columns)]

    return read


def pyme_hdf(path):
    with h5py.File(path) as file:
        records = file["Localizations"][:]
    lengths = {"x", "y", "z", "error_x", "error_y", "error_z", "sig", "x_raw", "y_raw", "z_raw", "focus"}
    columns = []
    for source in records.dtype.names:
        unit = "nm" if source in lengths else "frame" if source == "t" else None
        columns.extend(column(source, records[source], ([source], unit, 1.0, 0.0), short_type(records.dtype[source])))
    return [table("localisations", len(records), columns)]


def decode(path):
    with h5py.File(path) as file:
        data, meta = file["data"], file["meta"].attrs
        size = [float(value) for value in meta["px_size"]]
        assert meta["xy_unit"] == "px"
        xyz, xyz_sig = data["xyz"][:], data["xyz_sig"][()]
        columns = column(None, data["frame_ix"][:], FRAME) + column(None, data["phot"][:], PHOTONS)
        columns += column(None, data["bg"][:], (["background"], "photon", 1.0, 0.0)) + column(None, data["id"][:], one("id"))
        for axis, name in enumerate("xyz"):
            factor = size[axis] if axis < 2 else 1.0
            columns += column(None, xyz[:, axis], nm(name, factor=factor))
            if isinstance(xyz_sig, numpy.ndarray):
                columns += column(None, xyz_sig[:, axis], nm(f"error_{name}", factor=factor))
    return [table("localisations", len(xyz), columns)]


def storm_analysis(path):
    names = {
        "x": ("x", "nm"),
        "y": ("y", "nm"),
        "z": ("z", "nm"),
        "xsigma": ("sigx", "nm"),
        "ysigma": ("sigy", "nm"),
        "sum": ("nPhotons", "photon"),
        "height": ("height", None),
        "background": ("background", None),
        "error": ("error", None),
    }
    values = {}
    with h5py.File(path) as file:
        pixel = float(file.attrs["pixel_size"])
        groups = sorted((name for name in file if name.startswith("fr_")), key=lambda name: int(name[3:]))
        for group in groups:
            for source, data in file[group].items():
                values.setdefault(source, []).extend(data[:].tolist())
            values.setdefault("", []).extend([int(group[3:])] * len(file[group]["x"]))
    factors = {"x": pixel, "y": pixel, "xsigma": pixel, "ysigma": pixel, "z": 1e3}
    columns = column(None, values.pop(""), FRAME)
    for source, numbers in values.items():
        name, unit = names[source]
        columns += column(source, numbers, ([name], unit, factors.get(source, 1.0), 0.0))
    return [table("localisations", len(values["x"]), columns)]


def smap(path):
    columns = []
    with h5py.File(path) as file:
        group = file["saveloc/loc"]
        for source, data in group.items():
            rule = SMAP.get(source, ([source], None, 1.0, 0.0))
            columns += column(source, data[0], rule)
        rows = group["frame"].shape[1]
    return [table("localisations", rows, columns)]


def pmx(path):
    with h5py.File(path) as file:
        data = file["paraview/dataframe"]
        names = [name if isinstance(name, str) else name.decode() for name in data.attrs["column_names"]]
        values = data[:]
    columns = []
    for index, source in enumerate(names):
        columns += column(source, values[:, index], MINFLUX.get(source, ([source], None, 1.0, 0.0)))
    return [table("localisations", len(values), columns)]


def sptanalyser(path):
    with h5py.File(path) as file:
        records = file["trc/trcHmm"][:]
    rules = {
        "track id": one("track"),
        "frame": FRAME,
        "x position [μm]": nm("x", factor=1e3),
        "y position [μm]": nm("y", factor=1e3),
        "intensity [photon]": PHOTONS,
    }
    columns = []
    for source, rule in rules.items():
        columns += column(source, records[source], rule)
    return [table("localisations", len(records), columns)]


def image(path):
    if path.suffix == ".npy":
        values, axes = numpy.load(path), "ZYX"
    else:
        series = tifffile.TiffFile(path).series[0]
        values, axes = series.asarray(), series.axes
    # Planes of which the file says nothing (Q, I, S of tifffile) are taken along z.
    size = [1, 1, 1, *values.shape[-2:]]
    for letter, length in zip(axes[: values.ndim - 2], values.shape):
        size["TCZ".index(letter) if letter in "TCZ" else 2] *= length
    expected = column(None, values.ravel().tolist(), (["value"], None, 1.0, 0.0), short_type(values.dtype))
    return [table("image", int(values.size), expected) | {"size": size}]


IMAGES = [
    "colicoords/binary_storm.tif",
    "locan/images.tif",
    "python-microscopy/beads1.tif",
    "python-microscopy/psf_astig.tif",
    "thunderstorm/tubulins1_00020.tif",
    "trackpy/bulk-water_frame0.npy",
    "trackpy/bulk-water_frame1.npy",
    "trackpy/stuck.tif",
]


def members(data, archive, read):
    """One entry for each file in a zip archive."""
    content = (data / archive).read_bytes()
    for name in sorted(zipfile.ZipFile(io.BytesIO(content)).namelist()):
        place = Path("/tmp") / name
        place.write_bytes(zipfile.ZipFile(io.BytesIO(content)).read(name))
        found = entry(place.parent, name, read)
        yield {"file": archive, "member": name, "sha256": found["sha256"], "objects": found["objects"]}
        place.unlink()


def main(arguments):
    if len(arguments) not in (1, 2):
        print(__doc__.strip(), file=sys.stderr)
        return 2
    data = Path(arguments[0])
    out = Path(arguments[1]) if len(arguments) == 2 else Path(__file__).parent
    dialects = []

    def add(format_name, file, read, options=None):
        found = entry(data, file, read)
        head = {"file": file, "format": format_name, "sha256": found["sha256"]}
        dialects.append(head | ({"options": options} if options else {}) | {"objects": found["objects"]})

    for format_name, (files, names) in TEXT.items():
        for file in files:
            add(format_name, file, text(names))
    add("Zeiss ELYRA", "locan/Elyra_dstorm_data.txt", elyra)
    for name in ["dstorm_data", "from_images"]:
        add("rapidSTORM", f"locan/rapidSTORM_{name}.txt", rapidstorm)
    add("rapidSTORM tracks", "locan/rapidSTORM_dstorm_track_data.txt", rapidstorm)
    for file, (options, rules) in HEADERLESS.items():
        name = {"evalspt": "evalSPT", "trxyt": "trxyt"}.get(options.get("dialect"), "without a header")
        add(name, file, headerless(rules), options)
    save(out, "dialects", dialects)
    hdf5 = []
    for format_name, file, read in [
        ("PYME .hdf", "python-microscopy/test_hdf.hdf", pyme_hdf),
        ("DECODE .h5", "locan/decode_dstorm_data.h5", decode),
        ("DECODE .h5", "locan/decode_dstorm_data_empty.h5", decode),
        ("storm-analysis .hdf5", "storm-analysis/test_ref.hdf5", storm_analysis),
        ("storm-analysis .hdf5", "storm-analysis/test_sim.hdf5", storm_analysis),
        ("SMAP .mat (7.3)", "locan/smap_dstorm_data.mat", smap),
        ("SPTAnalyser .h5", "sptanalyser/Fab_CS2_cell01.h5", sptanalyser),
    ]:
        found = entry(data, file, read)
        hdf5.append({"file": file, "format": format_name} | found)
    for found in members(data, "pyminflux/pmx_format_versions.zip", pmx):
        hdf5.append({"format": "pyMINFLUX .pmx"} | found)
    save(out, "hdf5-formats", hdf5)
    images = [{"format": "TIFF" if file.endswith("tif") else "NumPy .npy"} | entry(data, file, image) for file in IMAGES]
    save(out, "images", images)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
