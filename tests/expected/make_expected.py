#!/usr/bin/env python3
"""Writes the expected contents of real localisation files, read with pandas, h5py and PyYAML only.

    python make_expected.py DATA [OUT]

DATA is the folder of the data files, OUT the folder of the written *.json (default: beside this script).
Nothing of this project's own code takes part. The README beside this script describes the fields.
"""

import csv
import hashlib
import json
import math
import re
import sys
from pathlib import Path

import h5py
import pandas
import yaml

FORMAT = "puncta.expected-tables/1"

THUNDERSTORM = [
    "colicoords/01_storm.csv",
    "locan/Thunderstorm_dstorm_data.csv",
    "pointgraphnet/sequence-as-stack-MT1.N1.LD-AS-Exp.csv",
    "pyme-smlm-import-tests/ThunderSTORM_TS3D.csv",
    "smolr/3d_localizations.csv",
    "sptanalyser/Fab_CS2_cell01.csv",
]
PYME_TEXT = ["python-microscopy/test_csv.csv"]
NAMED_TEXT = [
    "bstore/calibration_curves.csv",
    "bstore/locResults_A647_Pos0_processed.csv",
    "locan/five_blobs.txt",
    "locan/five_blobs_3D.txt",
    "pointgraphnet/mito_0.csv",
    "pointgraphnet/vesicle_0.csv",
    "pointgraphnet/vesicle_1.csv",
    "pyme-smlm-import-tests/CaulobacterC_2_R09_MoernerLab.csv",
    "pyme-smlm-import-tests/CaulobacterC_2_R09_stalk_MoernerLab.csv",
    "pyme-smlm-import-tests/U2OS_microtubules_ThunderSTORM_single_RiesLab.csv",
    "pyminflux/Fig2_U2OS_Tom70-Dreiklang_ATP5B_AB_Minflux3D.csv",
    "smlm-clustering/Training_EASY.csv",
    "smlm-clustering/Training_MEDIUM.csv",
]
PICASSO = [
    "picasso/egfr_mols.hdf5",
    "picasso/raw_movie_locs.hdf5",
    "picasso/raw_movie_locs_picked.hdf5",
    "picasso/testdata_locs.hdf5",
    "pyme-extra-sample-data/origami-simul3_locs.hdf5",
]
H5R = ["pyme-extra-sample-data/1_2_series_D.h5r"]

# Source name without its unit -> our names. A ThunderSTORM export counts frames from 1.
THUNDERSTORM_NAMES = {
    "frame": ["t"],
    "x": ["x"],
    "y": ["y"],
    "z": ["z"],
    "sigma": ["sig"],
    "sigma1": ["sigx"],
    "sigma2": ["sigy"],
    "intensity": ["nPhotons"],
    "offset": ["background"],
    "bkgstd": ["bkgstd"],
    "uncertainty": ["error_x", "error_y"],
    "uncertainty_xy": ["error_x", "error_y"],
    "uncertainty_z": ["error_z"],
    "chi2": ["chi2"],
    "id": ["id"],
    "detections": ["detections"],
}
# Source name -> (our name, unit in our table, in camera pixels in the file).
PICASSO_NAMES = {
    "x": ("x", "nm", True),
    "y": ("y", "nm", True),
    "lpx": ("error_x", "nm", True),
    "lpy": ("error_y", "nm", True),
    "sx": ("sigx", "nm", True),
    "sy": ("sigy", "nm", True),
    "std_x": ("std_x", "nm", True),
    "std_y": ("std_y", "nm", True),
    "z": ("z", "nm", False),
    "lpz": ("error_z", "nm", False),
    "frame": ("t", "frame", False),
    "photons": ("nPhotons", "photon", False),
    "bg": ("background", "photon", False),
}
# Flattened source name -> (our further name for it, its unit).
H5R_ALIASES = {
    "fitResults_x0": ("x", "nm"),
    "fitResults_y0": ("y", "nm"),
    "fitResults_A": ("A", None),
    "fitResults_sigma": ("sig", "nm"),
    "fitError_x0": ("error_x", "nm"),
    "fitError_y0": ("error_y", "nm"),
    "tIndex": ("t", "frame"),
}


def summary(values, factor=1.0, offset=0.0):
    """Statistics of factor * value + offset; NaN is missing and only counted."""
    converted = [value * factor + offset for value in values]
    numbers = [value for value in converted if not math.isnan(value)]
    return {
        "factor": factor,
        "offset": offset,
        "nan": len(converted) - len(numbers),
        "min": min(numbers, default=None),
        "max": max(numbers, default=None),
        "sum": math.fsum(numbers) if numbers else 0.0,
        "sum_abs": math.fsum(map(abs, numbers)) if numbers else 0.0,
    }


def number(text):
    """The number that a text field states, NaN for an empty field, None for anything else."""
    text = text.strip()
    if not text:
        return math.nan
    if "_" in text:
        return None
    try:
        return float(text)
    except ValueError:
        return None


def is_number(text):
    return bool(text.strip()) and number(text) is not None


def split_unit(source):
    """The name and the unit of "x [nm]" or "X (nm)"; no unit is None."""
    match = re.fullmatch(r"(.*?)\s*[\[(]([^\])]*)[\])]", source)
    return (match[1], match[2]) if match else (source, None)


def fields_of(line):
    return [field.strip() for field in next(csv.reader([line], skipinitialspace=True), [])]


def text_columns(path):
    """Names and fields of a comma-separated text: the names stand in the line above the first line of data."""
    lines = path.read_text(encoding="utf-8-sig").splitlines()
    first = next(
        index
        for index, line in enumerate(lines)
        if not line.startswith("#") and is_number(fields_of(line)[0])
    )
    names = fields_of(lines[first - 1].lstrip("# "))
    if len(names) == 1:
        # The whole line of names was quoted once more by a spreadsheet.
        names = fields_of(names[0])
    table = pandas.read_csv(
        path,
        header=None,
        names=range(len(names)),
        skiprows=first,
        dtype=str,
        keep_default_na=False,
        skipinitialspace=True,
        encoding="utf-8-sig",
    )
    return names, [table[index].tolist() for index in range(len(names))]


def text_column(source, fields, name, unit, offset=0.0):
    values = [number(field) for field in fields]
    column = {"source": source, "name": name, "unit": unit, "type": "number"}
    if any(value is None for value in values):
        column.update(type="text", unit=None, distinct=len({field.strip() for field in fields}))
    else:
        column.update(summary(values, offset=offset))
    return column


def thunderstorm(path):
    names, fields = text_columns(path)
    columns = []
    for source, values in zip(names, fields):
        base, unit = split_unit(source)
        is_frame = base == "frame"
        for name in THUNDERSTORM_NAMES[base]:
            columns.append(
                text_column(source, values, name, "frame" if is_frame else unit, -1.0 if is_frame else 0.0)
            )
    return [table("localisations", len(fields[0]), columns)]


def named_text(path):
    """Values as they stand in the file: which unit a bare name has is the reader's option."""
    names, fields = text_columns(path)
    columns = [
        text_column(source, values, None, split_unit(source)[1])
        for source, values in zip(names, fields)
    ]
    return [table("localisations", len(fields[0]), columns)]


def pyme_text(path):
    names, fields = text_columns(path)
    columns = [text_column(name, values, name, None) for name, values in zip(names, fields)]
    return [table("localisations", len(fields[0]), columns)]


def pixel_size(path):
    """The camera pixel in nm: the key Pixelsize of the last document that has it."""
    documents = yaml.safe_load_all(path.with_suffix(".yaml").read_text(encoding="utf-8"))
    sizes = [document["Pixelsize"] for document in documents if document and "Pixelsize" in document]
    return float(sizes[-1])


def short_type(dtype):
    return {"f": "f", "i": "i", "u": "u"}[dtype.kind] + str(8 * dtype.itemsize)


def picasso(path):
    pixel = pixel_size(path)
    with h5py.File(path) as file:
        records = file["locs"][:]
    columns = []
    for source in records.dtype.names:
        name, unit, in_pixels = PICASSO_NAMES.get(source, (source, None, False))
        column = {
            "source": source,
            "name": name,
            "unit": unit,
            "type": short_type(records.dtype[source]),
        }
        column.update(summary(records[source].tolist(), factor=pixel if in_pixels else 1.0))
        columns.append(column)
    return [table("localisations", len(records), columns)]


def leaves(records, prefix=""):
    """Every number of nested records, its name joined with underscores."""
    for name in records.dtype.names:
        if records.dtype[name].names:
            yield from leaves(records[name], f"{prefix}{name}_")
        else:
            yield f"{prefix}{name}", records[name]


def h5r(path):
    with h5py.File(path) as file:
        records = file["FitResults"][:]
        events = file["Events"][:]
    columns = []
    for source, values in leaves(records):
        statistics = summary(values.tolist())
        names = [(source, None)]
        if source in H5R_ALIASES:
            names.append(H5R_ALIASES[source])
        for name, unit in names:
            column = {"source": source, "name": name, "unit": unit, "type": short_type(values.dtype)}
            columns.append(column | statistics)
    time = events["Time"]
    event_columns = [
        {"source": "Time", "name": None, "unit": "s", "type": short_type(time.dtype)}
        | summary(time.tolist())
    ]
    for source in ["EventName", "EventDescr"]:
        event_columns.append(
            {
                "source": source,
                "name": None,
                "unit": None,
                "type": "text",
                "distinct": len(set(events[source].tolist())),
            }
        )
    return [
        table("localisations", len(records), columns),
        table("events", len(events), event_columns),
    ]


def table(name, rows, columns):
    return {"object": name, "rows": rows, "columns": columns}


def write(out, data, format_name, read, files):
    entries = [entry(data, file, read) for file in files]
    save(out, format_name, entries)


def entry(data, file, read):
    path = data / file
    content = path.read_bytes()
    return {
        "file": file,
        "sha256": hashlib.sha256(content).hexdigest(),
        "objects": read(path),
    }


def save(out, format_name, entries):
    place = out / f"{format_name}.json"
    place.write_text(document(format_name, entries), encoding="utf-8")
    print(f"{place}: {len(entries)} files")


def document(format_name, entries):
    """The JSON text with one line per column, so that a change shows as the columns that changed."""
    lines = [f'{{"format": "{FORMAT}", "files_format": "{format_name}", "files": [']
    for entry in entries:
        head = {key: value for key, value in entry.items() if key != "objects"}
        lines.append(json.dumps(head, ensure_ascii=False)[:-1] + ', "objects": [')
        for item in entry["objects"]:
            head = {key: value for key, value in item.items() if key != "columns"}
            lines.append(json.dumps(head)[:-1] + ', "columns": [')
            lines.append(",\n".join(json.dumps(c, allow_nan=False) for c in item["columns"]))
            lines.append("]},")
        lines[-1] = "]}"
        lines.append("]},")
    lines[-1] = "]}"
    return "\n".join(lines) + "\n]}\n"


def main(arguments):
    if len(arguments) not in (1, 2):
        print(__doc__.strip(), file=sys.stderr)
        return 2
    data = Path(arguments[0])
    out = Path(arguments[1]) if len(arguments) == 2 else Path(__file__).parent
    write(out, data, "thunderstorm", thunderstorm, THUNDERSTORM)
    write(out, data, "named-text", named_text, NAMED_TEXT)
    write(out, data, "pyme-text", pyme_text, PYME_TEXT)
    write(out, data, "picasso", picasso, PICASSO)
    write(out, data, "h5r", h5r, H5R)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
