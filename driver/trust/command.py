"""What a case or a campaign asks for, as `prismid trust` shows it before its user agrees."""

from __future__ import annotations

from pathlib import Path

from driver.batch.campaign import read_campaign
from driver.batch.requests import requests_of_campaign
from driver.case.consent import Request, agree, is_agreed, trusted_path
from driver.case.model import load_case
from driver.case.scheduler import requests_of_scheduler
from driver.case.solver_profiles import requests_of_profiles
from driver.case.toml import read_toml
from driver.results.files import batch_folder, link_requests, results_of


def asked_for(path: Path) -> list[Request]:
    """Return what a file asks for and was not agreed to yet.

    Args:
        path: of a case or of a campaign.

    Raises:
        InputError: it is neither, or cannot be used.
    """
    if {"specimen", "grains"} & set(read_toml(path, "a case or a campaign")):
        case = load_case(path)
        requests = [
            *requests_of_profiles(case),
            *requests_of_scheduler(case),
            *link_requests(results_of(case)),
        ]
    else:
        campaign = read_campaign(path)
        requests = [*requests_of_campaign(campaign), *link_requests(batch_folder(path))]
    return [request for request in requests if not is_agreed(request)]


def shown(request: Request) -> str:
    """Return a request in a line."""
    return f"{request.key}: {request.kind}: {request.told}"


def agreed(path: Path, requests: list[Request]) -> str:
    """Keep that the user agrees, and say where.

    Args:
        path: the file that asks.
        requests: what it asks for.

    Raises:
        InputError: nothing can be written there.
    """
    agree(requests)
    return f"{path}: agreed, and kept in {trusted_path()}; a change of it is asked for again"
