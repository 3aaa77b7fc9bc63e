"""Results kept by record."""

from advercity.identity_cache import cache_by_identity


def test_results_are_kept_for_a_record_and_not_for_one_that_is_equal():
    computed: list[dict[str, int]] = []

    @cache_by_identity(maxsize=2)
    def count(record: dict[str, int]) -> int:
        computed.append(record)
        return len(record)

    record, equal = {"a": 1}, {"a": 1}
    assert [count(record), count(record), count(equal)] == [1, 1, 1]
    assert len(computed) == 2


def test_the_records_that_were_not_used_for_longest_are_forgotten():
    computed: list[list[int]] = []

    @cache_by_identity(maxsize=1)
    def count(record: list[int]) -> int:
        computed.append(record)
        return len(record)

    first, second = [1], [1, 2]
    assert [count(first), count(second), count(first)] == [1, 2, 1]
    assert len(computed) == 3


def test_results_are_kept_by_the_other_arguments_too():
    computed: list[int] = []

    @cache_by_identity(maxsize=2)
    def add(record: list[int], number: int) -> int:
        computed.append(number)
        return sum(record) + number

    record = [1, 2]
    assert [add(record, 1), add(record, 2), add(record, 1)] == [4, 5, 4]
    assert computed == [1, 2]
