"""Invented results for the tests of this folder."""

from tests.driver.invented_results import measured as measured
from tests.driver.invented_results import results as results
from tests.driver.invented_results import written as written
