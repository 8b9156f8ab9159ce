"""`umo device conform` on a controller: tests the rules of the link in place of those of a driver."""

from __future__ import annotations

from umo.cycle.laid_out import wired_numbers
from umo.drivers.wrapping import bare
from umo.errors import DeclarationError
from umo.generate.split.controller_driver import Controller
from umo.objects import Compound, walk
from umo.testing.conformance import Certificate
from umo.testing.conformance.certificate import edition
from umo.testing.link_rules import LinkTrial, findings
from umo.wiring import Wired


def link_certificate(title: str, machine: Compound, wired: Wired, name: str) -> Certificate:
    """Try the rules of the link on a controller. No output is driven."""
    driver = bare(wired.drivers[name])
    assert isinstance(driver, Controller)
    path = next((each for each, other in wired.controllers.items() if other == name), None)
    if path is None:
        raise DeclarationError(f'no part runs on {name}: write "PART" = {{ controller = "{name}" }} in [wire]')
    part = next(node for node in walk(machine) if node._path == path)
    assert isinstance(part, Compound)
    with wired_numbers(machine, wired):
        plan = driver.take_part(part, wired)
        found = tuple(findings(LinkTrial(driver, plan)))
    objects = plan.model.objects
    return Certificate(
        name=title,
        driver=f"{type(driver).__module__}:{type(driver).__qualname__}",
        devices=tuple(driver.devices()),
        outputs=tuple(f"{objects[slot].path}, inhibited" for slot in plan.model.outputs),
        inputs=tuple(each.path for each in objects[: plan.model.inputs]),
        findings=found,
        **edition(),
    )
