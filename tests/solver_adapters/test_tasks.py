from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

from driver.common.parallel import side_by_side
from solver_adapters.tasks import as_one_of_several, is_one_of_several


def told(_: int) -> bool:
    return is_one_of_several()


def test_code_is_one_of_several_inside_a_task_and_not_after_it() -> None:
    assert not is_one_of_several()
    with as_one_of_several():
        assert is_one_of_several()
    assert not is_one_of_several()


def test_a_task_is_one_of_several_in_a_process_of_its_own_and_with_an_executor() -> None:
    assert side_by_side(told, [1, 2], 2) == [True, True]
    with ThreadPoolExecutor(1) as threads:
        assert side_by_side(told, [1, 2], 2, executor=threads) == [True, True]
        assert not threads.submit(is_one_of_several).result()
