"""A job that takes no time: all that the loop of long work writes, and nothing else."""

from pydantic import BaseModel

from cpic_planner.jobs import Job, Runner, Task, run


class Total(BaseModel):
    config_hash: str
    total: int


def square(number):
    return {"square": number**2}


def job():
    def work(runner: Runner):
        found = runner.finish(square, [Task("square 7", (7,))])
        return Total(config_hash=runner.digest, total=sum(body["square"] for body in found.values()))

    def write(folder, result, bodies):
        folder.write("pages/square.txt", f"{result.total}\n" * 20_000)

    return Job("squares", 1, dict, work, write=write, products=("pages/square.txt",))


def app(args, **_):
    """Stands for the commands of ``cpic``: its main program handles what this raises."""
    run(job(), args[args.index("--out") + 1], force="--force" in args)
