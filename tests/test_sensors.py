"""Rings by count and field of view, and the kinds of ring that a controller may need."""

import math
from pathlib import Path

import numpy as np
import pytest
from commands import Command

from navbench.contract import AnyRing
from navbench.sensors import Ring, Sensors, suite_of
from navbench.validation import DescriptionError

LIDAR = {"count": 7, "fov_deg": 270.0, "radius_m": 0.0}
SUITE = {"drawn_for_radius_m": 0.1, "max_range_m": 1.0}
YAML = """# A lidar
defaults: [/schema/sensors@_here_, _self_]
drawn_for_radius_m: 0.065
ring: {count: 7, fov_deg: 270, radius_m: 0.0}
max_range_m: 1.0
"""
OWN = """
from navbench.contract import AnyRing, Command


class Mine:
    sensor_kind = AnyRing(rays=8, fov_deg=180)

    def reset(self, setup, rng):
        self.sensors = setup.sensors

    def act(self, observation):
        return Command(0.1, 0.0)
"""


def a_suite(**ring: float) -> Sensors:
    return suite_of({**SUITE, "ring": ring})


def degrees_of(ring: Ring) -> list[float]:
    return [math.degrees(mount.heading_rad) for mount in ring.mounts()]


def test_a_rings_rays_go_from_the_right_edge_of_its_field_to_the_left_one() -> None:
    assert degrees_of(Ring(count=5, fov_deg=180.0, radius_m=0.1)) == pytest.approx([-90, -45, 0, 45, 90])
    assert degrees_of(Ring(count=3, fov_deg=90.0, radius_m=0.1, heading_deg=90.0)) == pytest.approx([45, 90, 135])
    assert [mount.role for mount in Ring(count=3, fov_deg=9.0, radius_m=0.1).mounts()] == ["ray_0", "ray_1", "ray_2"]


def test_a_ring_all_round_has_even_steps_and_no_ray_twice() -> None:
    assert degrees_of(Ring(count=4, fov_deg=360.0, radius_m=0.1)) == pytest.approx([-180, -90, 0, 90])


def test_a_single_ray_looks_along_the_middle() -> None:
    assert degrees_of(Ring(count=1, fov_deg=90.0, radius_m=0.1, heading_deg=30.0)) == pytest.approx([30])


@pytest.mark.parametrize(("count", "fov_deg"), [(36, 270.0), (7, 100.0)])
def test_a_ring_is_its_own_mirror_image_to_the_last_bit(count: int, fov_deg: float) -> None:
    mounts = Ring(count=count, fov_deg=fov_deg, radius_m=0.3).mounts()
    for left, right in zip(mounts, reversed(mounts), strict=True):
        assert (left.x_m, left.y_m, left.heading_rad) == (right.x_m, -right.y_m, -right.heading_rad)


def test_rays_stand_at_their_distance_and_those_of_a_lidar_meet_in_it() -> None:
    for radius_m in (0.0, 0.2):
        for mount in Ring(count=9, fov_deg=200.0, radius_m=radius_m, x_m=0.05, y_m=-0.01).mounts():
            dx, dy = mount.x_m - 0.05, mount.y_m + 0.01
            assert math.hypot(dx, dy) == pytest.approx(radius_m)
            assert (dx, dy) == pytest.approx(
                (radius_m * math.cos(mount.heading_rad), radius_m * math.sin(mount.heading_rad))
            )


def test_a_ring_grows_with_the_robot() -> None:
    suite = a_suite(count=5, fov_deg=180.0, radius_m=0.1, x_m=0.02).scaled_to(0.3)
    places = [(mount.x_m, mount.y_m) for mount in suite.mounts]
    wanted = [(mount.x_m, mount.y_m) for mount in Ring(count=5, fov_deg=180.0, radius_m=0.3, x_m=0.06).mounts()]
    assert np.array(places) == pytest.approx(np.array(wanted))


@pytest.mark.parametrize(
    ("ring", "message"),
    [
        ({"cont": 3}, "sensors.ring.cont: unknown key; did you mean count?"),
        ({"count": 0}, "sensors.ring.count=0: must be greater than or equal to 1"),
        ({"count": 10**9}, "sensors.ring.count=1000000000: must be less than or equal to 10000"),
        ({"fov_deg": 361.0}, "sensors.ring.fov_deg=361.0: must be less than or equal to 360"),
        ({"radius_m": -0.1}, "sensors.ring.radius_m=-0.1: must be greater than or equal to 0"),
    ],
)
def test_what_is_no_ring_is_refused_in_one_line(ring: dict[str, float], message: str) -> None:
    with pytest.raises(DescriptionError) as refused:
        suite_of({**SUITE, "ring": {**LIDAR, **ring}})
    assert message in str(refused.value)


def test_a_ring_stands_instead_of_a_list_of_mounts_and_not_beside_it() -> None:
    mounts = [{"role": "ahead", "x_m": 0.1, "y_m": 0.0, "heading_rad": 0.0}]
    with pytest.raises(DescriptionError, match=r"sensors\.mounts: must be empty, because sensors\.ring places all"):
        suite_of({**SUITE, "mounts": mounts, "ring": LIDAR})
    with pytest.raises(DescriptionError, match=r"sensors\.ring=3: must be a mapping"):
        suite_of({**SUITE, "ring": 3})


def test_a_suite_without_a_ring_is_called_as_before_and_one_with_a_ring_by_its_own_keys() -> None:
    from navbench.cli.configuration import compose_cell

    words = ("controller=go_to_goal", "world=empty")
    ring = "sensors.ring={count: 5, fov_deg: 90, radius_m: 1.0}"
    assert "ring" not in compose_cell(*words).configuration["sensors"]
    cell = compose_cell(*words, "sensors=disc_tracker", ring)
    assert cell.configuration["sensors"]["ring"] == {"count": 5, "fov_deg": 90, "radius_m": 1.0}
    assert cell.configuration["sensors"]["mounts"] == []
    assert len(cell.sensors.mounts) == 5


@pytest.mark.parametrize(
    ("kind", "ring", "lack"),
    [
        (AnyRing(8, 180.0), {"count": 8, "fov_deg": 180.0}, ""),
        (AnyRing(16, 180.0), {"count": 32, "fov_deg": 360.0}, ""),
        (AnyRing(16, 360.0), {"count": 16, "fov_deg": 360.0}, ""),
        (AnyRing(8, 180.0), {"count": 7, "fov_deg": 180.0}, "this suite has 7 there"),
        (AnyRing(8, 180.0), {"count": 13, "fov_deg": 360.0}, "this suite has 6 there"),
        (AnyRing(8, 180.0), {"count": 8, "fov_deg": 90.0}, "this suite sees nothing between -90 and -45 degrees"),
        (
            AnyRing(8, 180.0),
            {"count": 20, "fov_deg": 100.0, "heading_deg": 50.0},
            "this suite sees nothing between -90 and 0 degrees",
        ),
        (AnyRing(2, 10.0), {"count": 36, "fov_deg": 360.0}, "this suite has 1 there"),
    ],
)
def test_a_kind_of_ring_is_enough_rays_spread_over_the_field(kind: AnyRing, ring: dict[str, float], lack: str) -> None:
    assert kind.lack(a_suite(**ring, radius_m=0.1).range_sensors()) == lack


def test_a_controller_with_a_kind_drives_with_any_such_ring_and_is_refused_others(
    tmp_path: Path, command: Command
) -> None:
    (tmp_path / "mine.py").write_text(OWN)
    for group, text in (("controller", "# Mine\nbuild: {_target_: mine.Mine}\n"), ("sensors", YAML)):
        (tmp_path / "conf" / group).mkdir(parents=True)
        (tmp_path / "conf" / group / "mine.yaml").write_text(text)
    words = ("--config-dir", "conf", "controller=mine", "world=empty", "simulator=planar", "hydra.run.dir=out")
    done = command(*words, "sensors=mine")
    assert done.code == 2
    needs = "sensors=mine: mine needs any ring of at least 8 rays over 180 degrees; this suite has 5 there"
    assert done.err == f"navbench: {needs}\n"
    assert command(*words, "sensors=mine", "sensors.ring.count=13").code == 0
    (tmp_path / "mine.py").write_text(OWN.replace("AnyRing(rays=8, fov_deg=180)", "8"))
    assert command(*words).err.endswith("its sensor_kind must be an AnyRing\n")
