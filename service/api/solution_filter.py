"""The filter of solutions as parameters of a query, the same for every route that lists solutions."""

from typing import Annotated

from fastapi import Depends, Query

from service.store.filters import Filter


def _filter(wanted: Annotated[Filter, Query()]) -> Filter:
    # Of its own, since parameters are taken from the fields of a model where it is the only one.
    return wanted


FilterWanted = Annotated[Filter, Depends(_filter)]
