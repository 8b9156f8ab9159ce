"""A host application that knows only the specification of Sparkplug 3.0, and objects to what it does not allow."""

from __future__ import annotations

from typing import Any

from helpers.mqtt import SparkplugHost

KINDS = ("NBIRTH", "NDATA", "NDEATH")


class StrictHost(SparkplugHost):
    """`objections`: what the node has done against the specification, in words. Section numbers are those of 6.4."""

    def __init__(self, user: str = "ann") -> None:
        super().__init__(user)
        self.objections: list[str] = []
        self.births = self.deaths = self.data = self.historical = 0
        self.is_born: bool | None = None
        """None: not known, as the host has just come."""
        self._seq, self._bd_seq = -1, -1
        self._types: dict[str, int | str] = {}
        self._by_alias: dict[int, str] = {}

    def object(self, text: str) -> None:
        self.objections.append(text)

    def _take(self, message: dict[str, Any]) -> None:
        kind = message["kind"]
        if kind == "connected":
            self.is_born = None
        elif kind in KINDS:
            if message["retain"]:
                self.object(f"{kind} is retained")
            if message["qos"] != (1 if kind == "NDEATH" else 0):
                self.object(f"{kind} has QoS {message['qos']}")
            {"NBIRTH": self._birth, "NDATA": self._data, "NDEATH": self._death}[kind](message)
        super()._take(message)

    def _birth(self, message: dict[str, Any]) -> None:
        metrics = message.get("metrics", [])
        names = [each.get("name") for each in metrics]
        aliases = [each["alias"] for each in metrics if each.get("alias")]
        by_name = {each.get("name"): each for each in metrics}
        self.births += 1
        if not 0 <= message.get("seq", -1) <= 255:
            self.object(f"NBIRTH has seq {message.get('seq')}")
        if len(names) != len(set(names)) or not all(names):
            self.object("a name in NBIRTH is missing or there twice")
        if len(aliases) != len(set(aliases)):
            self.object("an alias in NBIRTH is there twice")
        if any(each.get("isHistorical") for each in metrics):
            self.object("NBIRTH has a historical metric")
        if "timestamp" not in message or not all("timestamp" in each for each in metrics):
            self.object("NBIRTH has no timestamp")
        if by_name.get("Node Control/Rebirth", {}).get("value") is not False:
            self.object("NBIRTH has no Node Control/Rebirth that is false")
        bd_seq = by_name.get("bdSeq", {}).get("value", -1)
        if not 0 <= bd_seq <= 255:
            self.object(f"bdSeq is {bd_seq}")
        if self.is_born is False and bd_seq == self._bd_seq:
            self.object(f"bdSeq {bd_seq} is that of the session before")
        if self.is_born and bd_seq != self._bd_seq:
            self.object(f"another session, bdSeq {bd_seq} after {self._bd_seq}, without NDEATH")
        self.is_born, self._seq, self._bd_seq = True, message.get("seq", -1), bd_seq
        self._types = {str(each.get("name")): each.get("type", "") for each in metrics}
        self._by_alias = {each["alias"]: each["name"] for each in metrics if each.get("alias")}

    def _data(self, message: dict[str, Any]) -> None:
        self.data += 1
        if self.is_born is None:
            return  # it has asked for NBIRTH
        if not self.is_born:
            self.object("NDATA before NBIRTH")
        if message.get("seq") != (expected := (self._seq + 1) % 256):
            self.object(f"seq {message.get('seq')} instead of {expected}")
        self._seq = message.get("seq", -1)
        for each in message.get("metrics", []):
            self._metric(each)

    def _metric(self, each: dict[str, Any]) -> None:
        name = each.get("name") or self._by_alias.get(each.get("alias", 0))
        self.historical += bool(each.get("isHistorical"))
        if name not in self._types:
            self.object(f"NDATA has {each.get('name') or each.get('alias')!r}, which was not in NBIRTH")
        elif each.get("type", self._types[name]) != self._types[name]:
            self.object(f"{name} has type {each['type']} instead of {self._types[name]}")
        if "timestamp" not in each:
            self.object(f"{name} has no timestamp")

    def _death(self, message: dict[str, Any]) -> None:
        metrics = message.get("metrics", [])
        if [each.get("name") for each in metrics] != ["bdSeq"]:
            self.object("NDEATH has other metrics than bdSeq")
        elif self.is_born and metrics[0]["value"] == self._bd_seq:
            self.is_born = False
            self.deaths += 1
