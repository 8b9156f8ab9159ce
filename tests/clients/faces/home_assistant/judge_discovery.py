"""Home Assistant's own schemas and templates judge discovery: one error a line, at last `judged`.

What is judged are JSON lines of [component, configuration, text of the state topic or null].

It runs in an environment of Home Assistant, not of umo.
"""

import asyncio
import importlib
import json
import sys
import tempfile

from homeassistant.components.sensor.const import DEVICE_CLASS_STATE_CLASSES, DEVICE_CLASS_UNITS
from homeassistant.core import HomeAssistant
from homeassistant.helpers import frame
from homeassistant.helpers.template import TemplateEnvironment


def rendered(template, text):
    return TemplateEnvironment(None).from_string(template).render(value=text, value_json=json.loads(text))


def judge(component, config, text):
    importlib.import_module(f"homeassistant.components.mqtt.{component}").DISCOVERY_SCHEMA(dict(config))
    if component == "sensor" and (name := config.get("device_class", "enum")) != "enum":
        unit, kind = config["unit_of_measurement"], config["state_class"]
        assert unit in DEVICE_CLASS_UNITS[name], f"{unit} is no unit of the class {name}"
        assert kind in DEVICE_CLASS_STATE_CLASSES[name], f"{kind} is not for the class {name}"
    if text is None:
        return
    for each in config["availability"]:
        if "value_template" in each:
            assert rendered(each["value_template"], text) in ("online", "offline"), f"availability of {text}"
    shown = rendered(config["value_template"], text)
    if shown == "None":
        return
    if "options" in config:
        assert shown in config["options"], f"{shown!r} is none of its options"
    elif component == "binary_sensor":
        assert shown in (config.get("payload_on", "ON"), config.get("payload_off", "OFF")), (
            f"{shown!r} is neither on nor off"
        )
    elif component == "number" or "state_class" in config:
        float(shown)


async def main():
    core = HomeAssistant(tempfile.gettempdir())  # its schemas ask for it
    if hasattr(frame, "async_setup"):
        frame.async_setup(core)
    for line in sys.stdin:
        component, config, text = json.loads(line)
        try:
            judge(component, config, text)
        except Exception as error:
            print(f"{component} {config.get('unique_id')}: {error!r}")
    print("judged")


asyncio.run(main())
