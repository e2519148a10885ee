"""What a campaign asks of its user: commands of its job scripts, and whom it talks to."""

from __future__ import annotations

from driver.batch.campaign import Campaign
from driver.case.consent import Request


def requests_of_campaign(campaign: Campaign) -> list[Request]:
    """Return what the file of a campaign asks for by itself; what the user's profiles say is his.

    Workers and a scheduler run whatever the other one sends.
    """
    requests = []
    cluster, scheduler = campaign.cluster, campaign.execution.scheduler
    if scheduler is not None:
        requests.append(Request("execution.scheduler", "a scheduler", (scheduler,)))
    if cluster is not None:
        for key in ("job_script_prologue", "job_extra_directives"):
            lines = getattr(cluster, key)
            if lines:
                requests.append(Request(f"cluster.{key}", "lines of a job script", tuple(lines)))
    return requests
