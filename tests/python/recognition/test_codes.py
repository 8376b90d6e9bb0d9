import json
import os
from pathlib import Path

import pytest

from videogrammetry.recognition import CODE_FAMILIES, CodeFamily, code_family, mirror_images

DATA = Path(os.environ.get("VIDEOGRAMMETRY_DATA", "../shared/data"))


def test_every_named_family_has_ascending_codes():
    for name in CODE_FAMILIES:
        family = code_family(name)
        assert family.name == name
        assert list(family.codes) == sorted(set(family.codes))
    assert code_family("none").bits == 0


@pytest.mark.data
def test_generated_tables_equal_published_ones():
    path = DATA / "ring-codes" / "code_tables.json"
    if not path.is_file():
        pytest.skip(f"{path} is not there")
    tables = json.loads(path.read_text())
    compared = 0
    for key, codes in tables.items():
        if not isinstance(codes, list):
            continue
        kind, *_, bits = key.split("_")
        name = f"{kind}-{bits}"
        if name in CODE_FAMILIES:
            assert list(code_family(name).codes) == codes, name
            compared += 1
    assert compared >= 6


@pytest.mark.parametrize("suffix", ["toml", "json"])
def test_a_users_table_is_read(tmp_path, suffix):
    path = tmp_path / f"ours.{suffix}"
    table = {"bits": 12, "ring": [1.8, 2.6], "codes": [71, 65, 75 << 3]}
    if suffix == "json":
        path.write_text(json.dumps(table))
    else:
        path.write_text("\n".join(f"{k} = {v}" for k, v in table.items()))
    family = code_family(path)
    assert family.name == "ours"
    assert family.bits == 12
    assert family.ring == (1.8, 2.6)
    assert family.codes == (71, 65, 75)  # in the order of the IDs; rotated back


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("bits = 3\ncodes = [1]", "bits: expected a whole number 4"),
        ("bits = 12", "codes: expected a list"),
        ("bits = 12\ncodes = [4096]", "4096 does not fit into 12 bits"),
        ("bits = 12\ncodes = [71, 65, 130]", r"IDs 2 and 3 are .* rotations of one \(65\)"),
        (
            "bits = 12\ncodes = [65, 71, 67]",
            r"ID 1 \(code 65\) and ID 3 \(code 67\) differ in one sector",
        ),
        ("bits = 12\ncodes = [65]\nmin_distance = 3", "min_distance: expected 1 or 2"),
        ("bits = 12\ncodes = [4095]", r"4095 \(ID 1\) has no border"),
        ("bits = 12\ncodes = [65]\nring = 3", "ring: expected"),
        ("bits = 12\ncodes = [65]\nring = [3, 2]", "inner < outer"),
        ("bits = 12\ncodes = [65]\nradius = 3", "unknown key 'radius'"),
        ("bits = = 12", "cannot be read"),
    ],
)
def test_a_malformed_table_is_refused_by_name(tmp_path, text, message):
    path = tmp_path / "codes.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match=message) as error:
        code_family(path)
    assert str(path) in str(error.value)


def test_codes_one_sector_apart_pass_with_a_warning_where_that_is_said(tmp_path):
    path = tmp_path / "printed.toml"
    path.write_text("bits = 12\ncodes = [65, 71, 67]\nmin_distance = 1")
    with pytest.warns(UserWarning, match="differ in one sector") as caught:
        assert len(code_family(path)) == 3
    assert str(path) in str(caught[0].message)


def test_mirror_images_are_named():
    family = CodeFamily(name="ours", bits=8, ring=(2.0, 3.0), codes=(11, 17, 13, 39))
    # 11 = 1011 and 13 = 1101 are mirror images, 17 and 39 (100111, seen 111001) are not.
    assert mirror_images(family) == ((1, 3),)
    # 416 of the 516 codes differ from their mirror image; the rule does not see a direction.
    assert len(mirror_images(code_family("schneider-14"))) == 208


def test_a_family_is_checked_once():
    family = code_family("schneider-14")
    assert family.core is family.core
    with pytest.raises(ValueError, match="not the smallest rotation"):
        _ = CodeFamily(name="turned", bits=8, ring=(2.0, 3.0), codes=(22,)).core


def test_unknown_names_list_the_known_ones(tmp_path):
    with pytest.raises(ValueError, match="schneider-14"):
        code_family("schneider-13")
    with pytest.raises(ValueError, match="cannot be read"):
        code_family(tmp_path / "absent.toml")
