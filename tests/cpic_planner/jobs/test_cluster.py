import pytest

from cpic_core import ClusterError
from cpic_planner.jobs.cluster import TaskQueue

ROOM = 8


def send(queue, flying=0):
    index = queue.next(flying, ROOM)
    if index is not None:
        queue.sent(index)
    return index


def test_tasks_go_in_order_while_there_is_room():
    queue = TaskQueue(3)
    assert queue.next(ROOM, ROOM) is None
    assert [send(queue, flying) for flying in range(4)] == [0, 1, 2, None]
    assert queue.left == 0


def test_lost_tasks_go_first_and_in_order():
    queue = TaskQueue(5)
    sent = [send(queue) for _ in range(3)]
    queue.put_back(reversed(sent))
    assert queue.left == 5
    assert [send(queue) for _ in range(5)] == [0, 1, 2, 3, 4]


def test_a_suspect_goes_last_and_alone_even_after_a_loss():
    queue = TaskQueue(3)
    assert send(queue) == 0
    queue.suspect(0, 4)
    assert [send(queue, 1), send(queue, 1)] == [1, 2]
    assert queue.next(1, ROOM) is None
    assert send(queue) == 0
    queue.put_back([0, 2])  # its connection was lost
    assert [send(queue), send(queue, 1), send(queue)] == [2, None, 0]


@pytest.mark.parametrize(("deaths", "trials"), [(1, 4), (2, 2), (4, 1), (11, 1)])
def test_blame_needs_four_deaths_alone_however_soon_dask_gives_up(deaths, trials):
    queue = TaskQueue(1)
    send(queue)
    queue.suspect(0, deaths)
    for _ in range(trials):
        queue.tell_blamed()  # nobody yet
        assert send(queue) == 0
        queue.suspect(0, deaths)
    assert queue.left == 0
    with pytest.raises(ClusterError, match="task 1 of 1 ended its worker .* all others are done"):
        queue.tell_blamed()


def test_it_may_be_all_of_them():
    queue = TaskQueue(50)
    for index in range(4):
        assert send(queue) == index
        queue.suspect(index, 4)
    while send(queue) != 49:
        pass
    assert send(queue) == 0
    queue.suspect(0, 4)
    assert send(queue) == 1
    queue.suspect(1, 4)
    assert send(queue) == 2
    with pytest.raises(ClusterError, match="task 1, 2, 3 of 50 ended its worker .* 1 others are not finished"):
        queue.suspect(2, 4)
