"""One profile for hypothesis: no deadlines, because the machines that run this are shared."""

from hypothesis import HealthCheck, settings

settings.register_profile("umo", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("umo")
