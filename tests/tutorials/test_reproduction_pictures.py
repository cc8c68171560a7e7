"""The reproduction: pictures of single motions, and what the report says of them."""

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from dynkit.systems import ImpactAttractor
from tests.tutorials.test_reproduction import PICTURES
from tutorials.cusumano_bai_1993.items import MAKERS
from tutorials.cusumano_bai_1993.section import Finding, Section
from tutorials.cusumano_bai_1993.workshop import Workshop

NUMBER = r"(\d[\d.e+-]*\d|\d)"


@pytest.fixture(scope="module")
def workshop(tmp_path_factory: pytest.TempPathFactory) -> Workshop:
    return Workshop(tmp_path_factory.mktemp("pictures"))


@pytest.fixture(scope="module")
def sections(workshop: Workshop) -> Mapping[str, Section]:
    return {item: MAKERS[item](workshop) for item in PICTURES}


@pytest.fixture
def findings(sections: Mapping[str, Section]) -> Mapping[str, Finding]:
    return {each.what: each for section in sections.values() for each in section.findings}


def number(pattern: str, text: str) -> float:
    """The one number that a text has in place of #."""
    (found,) = re.findall(re.escape(pattern).replace(re.escape("#"), NUMBER), text)
    return float(found)


def sampled_bending(attractor: ImpactAttractor, periods: int) -> float:
    """Root of <x K x> / <x x> from samples over so many periods of the table."""
    end = periods * 2.0 * np.pi / attractor.system.frequency
    times = np.linspace(0.0, end, 2000 * periods, endpoint=False)
    x = attractor.time_series(times)[:, :10]
    return float(np.sqrt(np.einsum("ki,ij,kj", x, attractor.system.stiffness, x) / (x * x).sum()))


@pytest.mark.parametrize("item", PICTURES)
@pytest.mark.parametrize("ending", ["png", "svg"])
def test_pictures_are_written_and_small(
    item: str, ending: str, workshop: Workshop, sections: Mapping[str, Section]
) -> None:
    assert sections[item].figures == [item]
    path: Path = workshop.folder / f"{item}.{ending}"
    assert 10_000 < path.stat().st_size < 1_000_000


def test_motions_are_simulated_once(workshop: Workshop) -> None:
    assert workshop.shown(0.87) is workshop.shown(0.87)


# --- spectra --------------------------------------------------------------------------------------


@pytest.mark.parametrize(("frequency", "periods", "count"), [("0.87", 3, 12), ("0.40816", 2, 2)])
def test_spectra_of_periodic_motions_have_lines_at_parts_of_the_table_frequency(
    frequency: str, periods: int, count: int, findings: Mapping[str, Finding]
) -> None:
    found = findings[f"spectrum at {frequency}"].found
    assert found.startswith(f"lines at multiples of {frequency}/{periods}, ")
    assert number(", # of the power off them", found) < 1e-20
    # what the closed form gives for P(1,3), and fine sampling for P(inf,2): tests of harmonics
    assert number("; # hold 99 %", found) == count


def test_sticking_motion_has_no_lines_of_four_table_periods(
    sections: Mapping[str, Section],
) -> None:
    assert number("0.40816/4: # of the power", sections["figure-9"].text) < 1e-20


def test_listed_lines_hold_what_the_label_counts(sections: Mapping[str, Section]) -> None:
    shares = [float(share) for share in re.findall(r"\| (\S+) % \|", sections["figure-7"].text)]
    assert len(shares) == 12
    assert sum(shares[:-1]) < 99.0 <= sum(shares)


def test_power_of_chaos_is_off_the_harmonics_of_the_table(findings: Mapping[str, Finding]) -> None:
    finding = findings["spectrum at 0.35"]
    assert 30.0 < number("# % of the power off", finding.found) < 80.0
    assert float(finding.error.removesuffix(" %")) < 10.0


# --- sections -------------------------------------------------------------------------------------


def test_one_impact_comes_back_every_three_table_periods(findings: Mapping[str, Finding]) -> None:
    assert findings["impact section at 0.87"].found == "1 point in 400 impacts"
    assert findings["stroboscopic section at 0.87"].found == "3 points in 1200 periods"


def test_sticking_motion_comes_back_every_two_table_periods(
    findings: Mapping[str, Finding],
) -> None:
    assert findings["stroboscopic section at 0.40816"].found.startswith("2 points in ")


def test_impacts_of_the_sticking_motion_run_up_to_the_table(
    findings: Mapping[str, Finding],
) -> None:
    found = findings["impact section at 0.40816"].found
    assert number("down to # above it", found) < 1e-5
    assert number("# points that run up", found) > 20


def test_unsettled_sticking_motion_alternates(sections: Mapping[str, Section]) -> None:
    (listed,) = re.findall(r"the velocities ((?:\d\.\d+, )+\d\.\d+)\.", sections["figure-10"].text)
    velocities = [float(velocity) for velocity in listed.split(", ")]
    assert len(velocities) == 4
    assert np.sign(np.diff(velocities)).tolist() == [1.0, -1.0, 1.0]


@pytest.mark.parametrize("kind", ["impact", "stroboscopic"])
def test_sections_of_chaos_have_hundreds_of_points(
    kind: str, findings: Mapping[str, Finding]
) -> None:
    points, states = re.findall(r"\d+", findings[f"{kind} section at 0.35"].found)
    assert int(points) > 0.99 * int(states) > 900


def test_nearby_motions_part_in_chaos(findings: Mapping[str, Finding]) -> None:
    found = findings["motions 1e-08 apart at 0.35"].found
    assert 10 < number("0.001 apart after # impacts", found) < 1000


@pytest.mark.parametrize("frequency", ["0.87", "0.40816"])
def test_nearby_motions_stay_together_on_periodic_ones(
    frequency: str, findings: Mapping[str, Finding]
) -> None:
    found = findings[f"motions 1e-08 apart at {frequency}"].found
    assert number("never farther apart than #,", found) < 1e-5
    assert number("and # after", found) < 4.5e-8


# --- surfaces -------------------------------------------------------------------------------------


def test_chaos_is_more_complex_in_space_and_more_so_with_less_damping(
    findings: Mapping[str, Finding],
) -> None:
    found = findings["shapes in figures 16a and 16b"].found
    calm, wild, sticking = (float(value) for value in re.findall(r"frequency (\d\.\d+)", found))
    assert 0.1495 < sticking < calm < wild < 0.4451  # the first two natural frequencies


@pytest.mark.parametrize(("item", "periods"), [("figure-13", 2), ("figure-17", 3)])
def test_bending_is_that_of_samples(
    item: str, periods: int, sections: Mapping[str, Section], workshop: Workshop
) -> None:
    (row,) = [line for line in sections[item].text.splitlines() if f"| {item[-2:]} " in line]
    cells = row.strip("| ").split(" | ")
    attractor = workshop.shown(float(cells[1]), float(cells[2]))
    # the fourth decimal was rounded, and samples of kinks are good to 1e-5
    error = float(cells[5]) + 6e-5
    assert abs(float(cells[4]) - sampled_bending(attractor, periods)) < error


def test_impacts_of_p13_are_all_the_range_of_the_velocity(findings: Mapping[str, Finding]) -> None:
    found = findings["edges in figure 17"].found
    assert number("jumps by # % of its range", found) > 99.0
    assert number("figure 13: # %", found) < 25.0
