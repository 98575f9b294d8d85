"""The root of what `workers` raise; each branch is defined beside what raises it.

It is a file of its own because those that raise import nothing from one another.

    WorkerError(RuntimeError)
        SourceError            workers.messages: a source did not do what it was asked
        ApiError               workers.client: a request that the coordinator cannot answer
        ExecutorError          workers.executor: asked for what it cannot do
        ForeignWorkerError     workers.ray_nodes: a worker process of another version
        ThreadError            workers.process_tree: more threads than a solve may have

Those that a user can cause and mend are a `core.errors.UserError` as well.
"""


class WorkerError(RuntimeError):
    """Something that carries, hands out or runs jobs cannot do its work."""
