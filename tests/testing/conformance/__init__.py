"""Drivers under the conformance kit, and the kit itself."""
