"""The portable format: a campaign as one file, with its hashes, its seeds and every solve.

`lines` says what stands in it, `container` packs and unpacks it, `checks` judges what came from elsewhere;
the rows come from `service.store.archive_io` and go back by `service.store.archive_io`.
"""
