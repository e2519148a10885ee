from pathlib import Path

from driver.report.style import new_figure
from driver.report.vector_files import write_vectors


def test_a_figure_is_written_as_pdf_and_svg_into_a_folder_that_is_made(tmp_path: Path) -> None:
    write_vectors("loads", new_figure(2.0), tmp_path / "a" / "b")
    folder = tmp_path / "a" / "b"
    assert (folder / "loads.pdf").read_bytes().startswith(b"%PDF")
    assert b"<svg" in (folder / "loads.svg").read_bytes()
