"""The conformance kit. It proves that a driver keeps its contract, or reports in sentences how the driver breaks it.

    with TcpTap("127.0.0.1", 5020) as tap:
        certificate = conform(
            Subject(
                name="my driver",
                make=lambda: MyDriver(host=tap.host, port=tap.port),
                outputs=(Output("dac:0", default=0, least=0, greatest=4095),),
                inputs=(Input("adc:0"),),
                loopbacks=(("dac:0", "adc:0"),),
                line=tap,
            )
        )
    assert certificate.passed, str(certificate)

`umo device conform` does this with a wiring; docs/howto-prove-a-driver.md describes both.
"""

from umo.testing.conformance.budget import TimePlan
from umo.testing.conformance.certificate import Certificate, Finding, Judgement, TransferTime
from umo.testing.conformance.pty_tap import PtyTap
from umo.testing.conformance.rules import Rule, all_rules
from umo.testing.conformance.runner import conform
from umo.testing.conformance.subject import Input, Output, Subject
from umo.testing.conformance.taps import Tap
from umo.testing.conformance.tcp_tap import TcpTap

__all__ = [
    "Certificate",
    "Finding",
    "Input",
    "Judgement",
    "Output",
    "PtyTap",
    "Rule",
    "Subject",
    "Tap",
    "TcpTap",
    "TimePlan",
    "TransferTime",
    "all_rules",
    "conform",
]
