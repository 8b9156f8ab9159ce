"""Certificates are compared with the page of the docs."""

from helpers.certificates import the_page_agrees

__all__ = ["the_page_agrees"]
