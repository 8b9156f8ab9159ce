"""The twin of the z-theta station: the bodies of plant.xml moved by the encoders, the part that is held, the valves."""

from pathlib import Path

from umo.plant.twin import Body, Colour, Cuboid, Cylinder, Sphere, Twin, Visible

from .control import Manipulator

OFF, ON, PUFF = "#3a4048", "#2ea043", "#1f9cf0"


def twin(machine: Manipulator) -> Twin:
    """Return the twin. z counts the height of the cup's tip in um; theta is positive clockwise, seen from above, like
    the model's joints. No object of the machine knows the positions of the courier and its parts."""
    model = Path(__file__).with_name("plant.xml").read_text("utf-8")
    return Twin.from_mujoco(model, joints={"z": "z.encoder", "theta": "theta.encoder"}, more=[
        Body(
            "part", [Cuboid((0.02, 0.02, 0.01), position=(0, 0, -0.005), colour="#339e4d")],
            parent="cup", drives=[Visible("gripper.pressure", "PASS")],
        ),
        Body(
            "suction valve", [Sphere(0.005, position=(0.012, -0.022, 0.15))],
            parent="z", drives=[Colour("gripper.vacuum", {"OFF": OFF, "ON": ON})],
        ),
        Body(
            "release valve", [Sphere(0.005, position=(-0.012, -0.022, 0.15))],
            parent="z", drives=[Colour("pressure_solenoid", {"OFF": OFF, "ON": PUFF})],
        ),
        Body(
            "counterweight valve", [Sphere(0.006, position=(-0.042, 0.13, 0.406))],
            parent="world", drives=[Colour("counterweight.vacuum", {"OFF": OFF, "ON": ON})],
        ),
        Body(
            "counterweight pressure", [Cylinder(0.008, 0.112, position=(-0.042, 0.13, 0.335))],
            parent="world", drives=[Colour("counterweight.pressure", {0: "#c9d3da", 752: "#2f6fb0", 1000: "#d0342c"})],
        ),
    ])  # fmt: skip
