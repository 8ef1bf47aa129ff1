"""The workbench: the laboratory in a browser, ``ctlabs workbench``.

How the pieces fit, from the inside out:

``desk``
    What a person does, without a page. ``session``: typed commands on a model and its experiments (open, edit a cell, run, compare,
    keep, undo …). ``Session(draft, *, store, runner)`` is made from a :class:`~ctlabs.workbench.desk.store.Draft`; it saves with
    ``store.edit(draft.id, text, label)`` at every edit and undoes with ``store.move(draft.id, number)``, so that it can be
    made again from the draft at any time. It may have ``close()``, called when its last tab is gone. One object per draft:
    tabs with the same draft share it. It knows no page and is tested without a browser. ``commands`` (with ``blocks`` and ``kinds``)
    are what a person can do to a model, each a class that does it; ``sheet`` shows a file as grids, constants and equations;
    ``store`` keeps drafts with all revisions, and experiments with settings, seed and results, in one SQLite file (``packing``);
    ``desk`` knows the open sessions by draft and the tabs that look at them; ``courses`` is a teacher's folder of this machine; ``tour``
    leads through the pages.
``runs``
    ``outcomes`` holds what is asked of an experiment and what comes out, ``experiments`` computes it by the studies
    (:mod:`ctlabs.studies`), ``figures`` says what its pictures show, ``comparing`` sets two side by side, ``exports`` (with
    ``reporting`` and ``programs``) makes files of one; ``catalogue`` is the same for the labs. ``running`` is the run of an experiment
    or of a lab as all tabs of a draft see it; the session has one of each. ``worker`` has long runs in processes of their own, by the
    names of a table: ``await runner.run("montecarlo", {…}, session=draft.id, progress=show, cancel=event)``; ``inside`` is its other
    end. What takes less than about 0.1 s is computed in place.
``pages``
    Thin views: ``page(session, shell)`` in one module per page draws, calls the session, and shows what it says; a page is
    found by listing the folder. ``shell`` is the frame with the list of pages, messages, keys, and light and dark.
``static``, ``help``
    Style sheets and scripts, which are in the head of every page, all with the prefix ``ctl-``; the texts of the help and of the
    guided tour, a TOML file for a group.
``serving``
    ``safety``, the guard around everything: which hosts, which origins, the token, sizes, and that nothing is loaded from elsewhere;
    ``server``: listening, and the order in which things are loaded; ``command``, its options.

Who is who: a *browser* is a cookie; a *tab* is a connection and one draft (``?draft=…`` in its address); an *owner* is whose
drafts and experiments are seen: one person's on a server that only this machine reaches, each browser's own elsewhere.

What a page needs to be quick: the first page is drawn before the library is loaded, so nothing here imports numpy, the library
or SQLAlchemy at the top of a module that ``serving.server`` or ``pages.shell`` imports.
"""
