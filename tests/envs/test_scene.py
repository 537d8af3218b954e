"""What a map looks like, by hand."""

from envs import ZONES, compile_scenario, load_scenario
from envs.render import to_text
from envs.scene import scene_of

S1 = compile_scenario(load_scenario("S1"))


def test_scene_of_the_paper_by_hand() -> None:
    scene = scene_of(S1)
    assert scene.outlines == {
        "target": (((4, 6), (4, 11), (9, 11), (9, 6)),),
        "uncomfortable": (((5, 7), (5, 10), (8, 10), (8, 7)),),
    }
    assert scene.cells_of("issuer") == [6 * 12 + 8]
    assert scene.cells_of("start") == [0]
    # 5 x 5 cells, of which 3 x 3 are uncomfortable or, in the middle, the issuer's.
    assert [scene.zone.count(zone) for zone in ZONES] == [95, 16, 8, 1]


def test_people_who_talk_have_a_circle_and_bystanders_no_region() -> None:
    changes = {"issuer.position": [[1, 4], [1, 8]], "others": [{"position": [1, 6]}]}
    scene = scene_of(compile_scenario(load_scenario("TwoTalking", changes)))
    assert scene.circle == (1.5, 6.5, 2.0)
    assert (scene.cells_of("issuer"), scene.cells_of("bystander")) == ([12 + 4, 12 + 8], [12 + 6])
    assert (scene.zone[12 + 6], bool(scene.is_over[12 + 6])) == ("outside", True)
    assert to_text(scene, 0, "none").splitlines()[1].split()[4:9:2] == ["I", "B", "I"]
