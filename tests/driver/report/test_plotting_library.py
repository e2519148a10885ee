import base64
import gzip
import hashlib
import re

import pytest

from driver.report.plotting_library import FLAT, FOLDER, SOLID, bundle, licence


@pytest.mark.parametrize("name", [FLAT, SOLID])
def test_a_bundle_is_the_file_whose_hash_stands_beside_it(name: str) -> None:
    script = gzip.decompress(base64.b64decode(bundle(name)))
    readme = (FOLDER / "README.md").read_text("utf-8")
    (expected,) = re.findall(rf"`plotly-{name}.min.js.gz` \|.*`([0-9a-f]{{64}})`", readme)
    assert hashlib.sha256(script).hexdigest() == expected
    (version,) = re.findall(r"^# plotly.js (\S+)", readme)
    assert "plotly.js (" in script[:200].decode() and f"v{version}" in script[:200].decode()


def test_the_licence_is_there() -> None:
    assert "MIT License" in licence() and "</" not in licence()
