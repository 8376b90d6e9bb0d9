"""A project's folder verified: everything at once, and what is said when something lacks."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from two_pairs import falling, write_project

from videogrammetry.errors import MeasurementError, ProjectFileError, TableError
from videogrammetry.pipeline import verify_project
from videogrammetry.pipeline.verify import known_lengths, verification_document
from videogrammetry.project import ScaleBar, VerifySection, plain, read_project

EVERYTHING = '[verify]\nscale_bars = "bars.csv"\nfree_fall = [1, 30]\ntruth = "truth"\n'


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("fall")
    write_project(path, falling(11, stages=30), EVERYTHING)
    return path


def test_everything_at_once(folder: Path) -> None:
    project = read_project(folder)
    result = verify_project(project)
    assert result.warnings == ()
    assert abs(result.free_fall.fit.deviation_sigmas) < 5
    assert result.truth.missing.shape[0] == result.truth.visible - result.truth.measured > 0
    assert result.truth.total.image_normalised_rms == pytest.approx(1, abs=0.15)
    assert [s.name for s in result.reprojection] == ["cam1", "cam2", "cam3", "cam4", "all"]
    bars = result.scale_bars
    assert result.scale_bar_rig_error_mm.shape == bars.error_mm.shape
    # What is left when the calibration's actual error is out is noise.
    rest = (bars.error_mm - result.scale_bar_rig_error_mm) / bars.sigma_image_mm
    assert (rest**2).mean() == pytest.approx(1, abs=5 * np.sqrt(2 / len(rest)))
    hashes = result.provenance["inputs_sha256"]
    assert {"rig.json", "rig.npz", "measurement.h5", "bars.csv", "truth/rig.json"} <= set(hashes)
    document = json.loads(json.dumps(plain(verification_document(result))))
    assert document["free_fall"]["fit"]["g_m_s2"] == pytest.approx(9.8, abs=0.1)
    assert document["options"]["free_fall"] == [1, 30]


def test_options_alone(folder: Path) -> None:
    project = read_project(folder)
    result = verify_project(project, options=VerifySection(free_fall=(2, 20), points=(1, 2, 3, 9)))
    assert result.truth is result.scale_bars is result.scale_bar_rig_error_mm is None
    assert result.free_fall.fit.point_id.tolist() == [1, 2, 3, 9]


def test_without_a_covariance_it_is_said(tmp_path: Path) -> None:
    scene = falling(12, stages=8)
    write_project(tmp_path, scene, '[verify]\nscale_bars = "bars.csv"\n')
    rig = json.loads((tmp_path / "rig.json").read_text())
    rig.pop("covariance")
    (tmp_path / "rig.json").write_text(json.dumps(rig))
    (tmp_path / "rig.npz").unlink()
    result = verify_project(read_project(tmp_path))
    assert any("no covariance" in warning for warning in result.warnings)
    assert (result.scale_bars.sigma_rig_mm == 0).all()


def test_what_lacks_is_named(folder: Path) -> None:
    project = read_project(folder)
    with pytest.raises(ProjectFileError, match="nothing to verify against: give lengths"):
        verify_project(project, options=VerifySection())
    with pytest.raises(TableError, match="there is no such table"):
        verify_project(project, options=VerifySection(scale_bars=folder / "none.csv"))
    with pytest.raises(
        ProjectFileError, match=r"nothing.rig\.json: there is no such file; give the folder"
    ):
        verify_project(project, options=VerifySection(truth=folder / "nothing"))
    with pytest.raises(MeasurementError, match="stages 31 to 40 were asked for, measured"):
        verify_project(project, options=VerifySection(free_fall=(31, 40)))
    (folder / "strange.csv").write_text("point_a,point_b,length_mm,sigma_mm\n70,71,100,0.1\n")
    with pytest.raises(MeasurementError, match="no bar has both ends measured at one stage"):
        verify_project(project, options=VerifySection(scale_bars=folder / "strange.csv"))


def test_lengths_at_their_temperature() -> None:
    bar = ScaleBar(
        point_a=1, point_b=2, length_mm=1000.0, sigma_mm=0.01,
        alpha_per_K=1e-5, temperature_C=30.0,
    )  # fmt: skip
    plain_bar = ScaleBar(point_a=1, point_b=2, length_mm=1000.0, sigma_mm=0.01)
    lengths = known_lengths([bar, plain_bar])
    assert [length.length_mm for length in lengths] == pytest.approx([1000.1, 1000.0])
