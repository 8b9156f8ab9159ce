"""Home Assistant's own schemas judge discovery: JSON lines of [component, configuration]; one error a line.

It runs in an environment of Home Assistant, not of umo.
"""

import importlib
import json
import sys

for line in sys.stdin:
    component, config = json.loads(line)
    module = importlib.import_module(f"homeassistant.components.mqtt.{component}")
    try:
        module.DISCOVERY_SCHEMA(config)
    except Exception as error:
        print(f"{component} {config.get('unique_id')}: {error}")
print("judged")
