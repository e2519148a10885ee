"""Names of the files of a run's results."""

from __future__ import annotations

RESULTS = "results"


MESH, FINE_MESH = "mesh.med", "mesh_fine.med"


MEASURE, MEASURE_CSV = "measure.h5", "measure.csv"


IDENTIFY, IDENTIFY_CSV, HISTORY_JSON = "identify.h5", "identify.csv", "identify_history.json"


DIAGNOSIS, DIAGNOSIS_H5 = "diagnosis.json", "diagnosis.h5"


EXTENDED, NOISE_MAP = "extended.toml", "noise_map.tif"

DECKS = "extended_decks"
