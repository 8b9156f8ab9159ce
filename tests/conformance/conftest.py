"""Certificates are compared with the page of the docs."""

from helpers.certificates import certify, the_page_agrees

__all__ = ["certify", "the_page_agrees"]
