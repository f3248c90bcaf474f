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
        found = runner.finish(square, [Task(f"square {i}", (i,)) for i in range(3)])
        return Total(config_hash=runner.digest, total=sum(body["square"] for body in found.values()))

    def write(folder, result, bodies):
        folder.write("squares.csv", "".join(f"{key},{body['square']}\n" for key, body in bodies.items()))
        folder.write("pages/square.txt", f"{result.total}\n")

    return Job("squares", 1, lambda: {}, work, write=write, products=("squares.csv", "pages/square.txt"))


def app(args, **_):
    """Stands for the commands of ``cpic``: its main program handles what this raises."""
    run(job(), args[args.index("--out") + 1], force="--force" in args)
