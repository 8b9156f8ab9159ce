"""Tests of drivers for interfaces of the kernel, in the test kernel."""
