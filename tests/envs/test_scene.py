"""What a map looks like, by hand."""

from envs import compile_scenario, load_scenario
from envs.render import to_text
from envs.scene import scene_of


def test_people_who_talk_have_a_circle_and_bystanders_no_region() -> None:
    changes = {"issuer.position": [[1, 4], [1, 8]], "others": [{"position": [1, 6]}]}
    scene = scene_of(compile_scenario(load_scenario("TwoTalking", changes)))
    assert scene.circle == (1.5, 6.5, 2.0)
    assert (scene.cells_of("issuer"), scene.cells_of("bystander")) == ([12 + 4, 12 + 8], [12 + 6])
    assert (scene.zone[12 + 6], bool(scene.is_over[12 + 6])) == ("outside", True)
    assert to_text(scene, 0, "none").splitlines()[1].split()[4:9:2] == ["I", "B", "I"]
