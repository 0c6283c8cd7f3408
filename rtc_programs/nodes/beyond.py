"""Whether a value is beyond a limit, without flickering about it."""

from engines.nodes import Case, Input, Node, Output, Param


class Beyond(Node):
    """Whether a value is beyond a limit: from the limit on, until it is below a share of it again."""

    value = Input("number")
    beyond = Output("flag")
    limit = Param(5.0, "from here on it is beyond", low=0.0)
    back = Param(0.8, "share of the limit below which it is not any more", low=0.0, high=1.0)

    cases = [
        Case(inputs=[{"value": 4.9}], outputs={"beyond": False}),
        Case(inputs=[{"value": 5.0}], outputs={"beyond": True}),
        Case(name="it stays until it is well below", inputs=[{"value": 6.0}, {"value": 4.1}], outputs={"beyond": True}),
        Case(inputs=[{"value": 6.0}, {"value": 3.9}, {"value": 4.5}], outputs={"beyond": False}),
    ]

    def start(self) -> None:
        self._was = False

    def step(self) -> None:
        self._was = self.value >= (self.back * self.limit if self._was else self.limit)
        self.beyond = self._was
