"""What became of a portable file."""

from service.api.schemas import Answer


class TakenInView(Answer):
    """A campaign that came as a file; all zero, and no names, if everything was there already."""

    #: That of the campaign that the file is about, as it is called here.
    campaign_id: int
    #: By name, with those that only give seeds.
    new_campaigns: list[str]
    n_solves: int
    n_solutions: int
    n_certificates: int
