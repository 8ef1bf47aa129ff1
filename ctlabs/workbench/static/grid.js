// Text cells: a matrix with its headers, or one field. What is typed is sent after a moment's pause and is never overwritten by an
// older answer: every message has a number, and the server says up to which number its texts go (`ack`).
// A number as it is kept: 0,5 is 0.5, 1 000 is 1000. The server reads what is typed; this only keeps the caret where it is.
const plain = (text) => text.trim().replace(/[−–]/g, "-").replace(/[\s\u2009\u202f](?=\d{3})/g, "").replace(",", ".");
const PAUSE = { text: 120, area: 400, range: 60 };

// What is typed and not answered yet, on the whole page: meanwhile the page does not say that all is saved.
const open = new Map();
const tell = (element, keys) => {
  if (keys.length) open.set(element, keys);
  else open.delete(element);
  document.body.toggleAttribute("data-typing", open.size > 0);
};

export default {
  template: `
    <div class="ctl-cells" :data-name="name" @focusin="focused" @focusout="left" @input="typed" @keydown="key" @paste="pasted">
      <div v-if="mode === 'grid'" class="ctl-scroll">
        <table class="ctl-grid" :aria-label="label">
          <thead v-if="columnNames">
            <tr>
              <td class="ctl-corner"></td>
              <th v-for="(column, j) in columnNames" :key="j" scope="col" :title="column">
                <span class="ctl-colname">{{ column }}</span>
                <button v-if="removeColumn" type="button" class="ctl-x" :title="'Remove ' + removeColumn + ' ' + column"
                  :aria-label="'Remove ' + removeColumn + ' ' + column" :data-test="'remove-' + removeColumn + '-' + j"
                  :disabled="columnNames.length < 2" @click="remove(removeColumn, j)">×</button>
              </th>
            </tr>
          </thead>
          <tbody v-for="(row, i) in steady" :key="i"
            v-memo="[row, rowNames[i], rowUnits?.[i], rowProblems?.[i], columnNames, rows.length, removeColumn, described]">
            <tr>
              <th scope="row" :class="{ 'ctl-editable': !!rowKind }">
                <template v-if="rowKind">
                  <span class="ctl-rowname">
                    <input class="ctl-name" v-bind="about('name,' + i, 'Name of ' + rowKind + ' ' + (i + 1), rowProblems[i])"
                      :data-r="i" data-c="-2" :data-test="rowKind + '-name-' + i" />
                    <button type="button" class="ctl-x" :title="'Remove ' + rowKind + ' ' + rowNames[i] + ' (Ctrl+Delete in its name)'"
                      tabindex="-1" :aria-label="'Remove ' + rowKind + ' ' + rowNames[i]" :data-test="'remove-' + rowKind + '-' + i"
                      :disabled="rows.length < 2" @click="remove(rowKind, i)">×</button>
                  </span>
                  <input class="ctl-unit" v-bind="about('unit,' + i, 'Unit of ' + rowKind + ' ' + (i + 1), '')" placeholder="unit"
                    :data-r="i" data-c="-1" :data-test="rowKind + '-unit-' + i" />
                </template>
                <span v-else :title="rowNames[i]">{{ rowNames[i] }}</span>
              </th>
              <td v-for="(cell, j) in row" :key="j">
                <input class="ctl-cell" v-bind="about(i + ',' + j, cellLabel(i, j), cell[2])" :title="hint(i, j, cell)"
                  :style="{ width: widths[j] }" :class="{ 'ctl-zero': cell[0] === '0' }" :data-r="i" :data-c="j"
                  :data-path="path(i, j)" :data-test="'cell-' + name + '-' + i + (columnNames ? '-' + j : '')" />
                <span v-if="cell[1]" class="ctl-value">{{ cell[1] }}</span>
              </td>
            </tr>
            <tr v-if="wrong(i).length" class="ctl-wrong">
              <td :colspan="row.length + 1"><div class="ctl-stick">
                <div v-for="[key, where, message] in wrong(i)" :key="key" :id="place(key)" class="ctl-error">
                  <b>{{ where }}</b> {{ message }}</div>
              </div></td>
            </tr>
          </tbody>
        </table>
      </div>
      <div v-else-if="mode === 'entries'" class="ctl-scroll">
        <table class="ctl-grid ctl-entries" :aria-label="label">
          <thead><tr><th scope="col">row</th><th scope="col">column</th><th scope="col">entry</th></tr></thead>
          <tbody v-for="(row, i) in steady" :key="places[i]" v-memo="[row, rowNames[i], described]">
            <tr>
              <th scope="row">{{ rowNames[i] }}</th><td class="ctl-colof">{{ columnNames[i] }}</td>
              <td>
                <input class="ctl-cell" v-bind="about(places[i], name + ', ' + rowNames[i] + ', ' + columnNames[i], row[0][2])"
                  :style="{ width: widths[0] }" :class="{ 'ctl-zero': row[0][0] === '0' }" :data-r="i" data-c="0"
                  :title="hint(...places[i].split(','), row[0])" :data-path="path(...places[i].split(','))"
                  :data-test="'cell-' + name + '-' + places[i].replace(',', '-')" />
                <span v-if="row[0][1]" class="ctl-value">{{ row[0][1] }}</span>
                <div v-if="row[0][2]" :id="place(places[i])" class="ctl-error">{{ row[0][2] }}</div>
              </td>
            </tr>
          </tbody>
        </table>
      </div>
      <template v-else>
        <label v-if="label && mode !== 'range'" :for="place('field')" :class="{ 'ctl-hidden': !showLabel }">{{ label }}</label>
        <span class="ctl-field">
          <template v-if="mode === 'area'">
            <pre class="ctl-gutter" ref="gutter" aria-hidden="true"></pre>
            <textarea v-bind="about('0,0', '', rows[0][0][2])" class="ctl-area" wrap="off" :id="place('field')" rows="26"
              :placeholder="placeholder" :data-test="test" @scroll="$refs.gutter.scrollTop = $event.target.scrollTop"></textarea>
          </template>
          <input v-else-if="mode === 'range'" v-bind="about('0,0', label, '')" type="range" :min="limits[0]" :max="limits[1]"
            :step="limits[2]" :disabled="disabled" :aria-valuetext="rows[0][0][1]" :title="hinted" :data-test="test" />
          <input v-else class="ctl-cell" v-bind="about('0,0', '', rows[0][0][2])" :id="place('field')"
            :placeholder="placeholder" :data-test="test" data-r="0" data-c="0" />
          <span v-if="suffix" class="ctl-suffix" aria-hidden="true">{{ suffix }}</span>
        </span>
        <span v-if="mode === 'text' && rows[0][0][1]" class="ctl-value">{{ rows[0][0][1] }}</span>
        <div v-if="mode !== 'range' && rows[0][0][2]" :id="place('0,0')" class="ctl-error">{{ rows[0][0][2] }}</div>
      </template>
      <div v-if="problem" class="ctl-error ctl-whole" :id="place('whole')">{{ problem }}</div>
    </div>`,
  props: {
    name: String,
    label: String,
    mode: String,
    rows: Array, // of rows of [text, value, problem]; what is empty at the end is left out
    rowNames: Array,
    columnNames: Array,
    places: Array, // of entries: "row,column"
    rowKind: String,
    rowUnits: Array,
    rowProblems: Array,
    removeColumn: String,
    problem: String,
    ack: Number,
    test: String,
    placeholder: String,
    suffix: String,
    showLabel: Boolean,
    lazy: Boolean,
    limits: Array,
    disabled: Boolean,
    hinted: String,
  },
  emits: ["edit", "block", "remove", "done"],
  created() {
    this.known = {}; // the texts of the last answer
    this.sent = {}; // the number of the last message about a cell
    this.waiting = {}; // cells that were typed into and not sent yet: their timers
    this.before = ""; // the text of the cell when it was entered
    this.number = 0;
    this.shown = []; // what was shown by the last sync
  },
  mounted() {
    this.number = this.ack; // the page may have been drawn again
    this.sync();
    // Before any combination of keys (undo, another page) and before the page goes, what was typed goes first.
    this.first = (event) => (event.type !== "keydown" || event.ctrlKey || event.metaKey || event.altKey) && this.flush();
    window.addEventListener("keydown", this.first, true);
    window.addEventListener("pagehide", this.first);
    document.addEventListener("visibilitychange", this.first);
  },
  updated() {
    if (this.shown.some((each, i) => each !== this.given()[i])) this.sync();
    this.tell();
  },
  beforeUnmount() {
    this.flush();
    tell(this, []);
    window.removeEventListener("keydown", this.first, true);
    window.removeEventListener("pagehide", this.first);
    document.removeEventListener("visibilitychange", this.first);
  },
  computed: {
    // A row that says the same is the same row, so that it is not drawn again.
    steady() {
      const rows = this.rows.map((row, i) => (this.texts?.[i] === JSON.stringify(row) ? this.drawn[i] : row));
      this.texts = rows.map((row) => JSON.stringify(row));
      return (this.drawn = rows);
    },
    widths() {
      if (this.mode !== "grid" && this.mode !== "entries") return [];
      const columns = Math.max(0, ...this.rows.map((row) => row.length));
      return Array.from({ length: columns }, (_, j) => {
        const longest = Math.max(...this.rows.map((row) => (row[j]?.[0] ?? "").length));
        return `${Math.min(Math.max(longest + 2, 6), 22)}ch`;
      });
    },
    described() {
      return `${this.problem ? 1 : 0} ${this.widths.join()}`;
    },
  },
  methods: {
    place(key) {
      return `${this.$el?.id || this.$attrs.id}-${key.replace(",", "-")}`;
    },
    about(key, label, problem) {
      const by = [problem ? this.place(key) : "", this.problem ? this.place("whole") : ""].filter(Boolean).join(" ");
      return {
        "data-key": key,
        "aria-label": label || null,
        "aria-invalid": problem ? "true" : null,
        "aria-describedby": by || null,
        spellcheck: "false",
        autocomplete: "off",
        autocapitalize: "off",
      };
    },
    cellLabel(i, j) {
      const column = this.columnNames ? `, column ${j + 1} ${this.columnNames[j] ?? ""}` : "";
      return `${this.name}, row ${i + 1} ${this.rowNames[i] ?? ""}${column}`;
    },
    wrong(i) {
      const found = this.rowProblems?.[i] ? [[`name,${i}`, this.rowNames[i], this.rowProblems[i]]] : [];
      this.rows[i].forEach((cell, j) => {
        const column = this.columnNames?.[j];
        if (cell[2]) found.push([`${i},${j}`, column ? `${this.rowNames[i]}, ${column}:` : `${this.rowNames[i]}:`, cell[2]]);
      });
      return found;
    },
    text(key) {
      const [first, second] = key.split(",");
      if (first === "name") return this.rowNames[second];
      if (first === "unit") return this.rowUnits[second];
      if (this.mode === "entries") return this.rows[this.places.indexOf(key)]?.[0]?.[0] ?? "";
      return this.rows[first]?.[second]?.[0] ?? "";
    },
    given() {
      return [this.rows, this.ack, this.rowNames, this.rowUnits];
    },
    path(i, j) {
      return `model.${this.name}[${i}]` + (this.columnNames || this.places ? `[${j}]` : "");
    },
    hint(i, j, cell) {
      return `${this.path(i, j).slice(6)} = ${cell[0]}${cell[1] ? " " + cell[1] : ""}`;
    },
    sync() {
      this.shown = this.given();
      for (const field of this.$el.querySelectorAll("[data-key]")) {
        const key = field.dataset.key, text = this.text(key);
        if (key in this.waiting || (this.sent[key] ?? 0) > this.ack) continue;
        // In the cell that is typed into only what is new there is shown: nothing moves the caret without need.
        const typing = field === document.activeElement;
        if (field.value !== text && !(typing && (this.known[key] === text || plain(field.value) === text))) {
          field.value = text;
          if (typing) this.before = text;
        }
        this.known[key] = text;
        this.numberLines(field);
      }
    },
    typed(event) {
      const field = event.target, key = field.dataset.key;
      if (!key) return;
      // Of a slider that is moved on and on something is sent now and then, of a text when there is a pause.
      if (this.mode === "range" && key in this.waiting) return;
      clearTimeout(this.waiting[key]);
      this.waiting[key] = this.lazy ? 0 : setTimeout(() => this.send(field), PAUSE[this.mode] ?? PAUSE.text);
      this.tell();
      this.numberLines(field);
    },
    send(field, now = false) {
      const key = field.dataset.key;
      if (!(key in this.waiting)) return;
      clearTimeout(this.waiting[key]);
      if (this.mode === "range" && !now && (this.sent[key] ?? 0) > this.ack) {
        this.waiting[key] = setTimeout(() => this.send(field), PAUSE.range); // not before the answer to the last one
        return;
      }
      delete this.waiting[key];
      if (field.value.trim() === String(this.text(key)).trim() && (this.sent[key] ?? 0) <= this.ack) return this.tell();
      this.sent[key] = ++this.number;
      this.$emit("edit", { number: this.number, key, text: field.value });
    },
    tell() {
      tell(this, [...Object.keys(this.waiting), ...Object.keys(this.sent).filter((key) => this.sent[key] > this.ack)]);
    },
    flush() {
      for (const key of Object.keys(this.waiting)) {
        const field = this.$el.querySelector(`[data-key="${key}"]`);
        if (field) this.send(field, true);
      }
    },
    focused(event) {
      if (!event.target.dataset?.key) return;
      this.before = event.target.value;
      if (event.target.matches(".ctl-cell, .ctl-name, .ctl-unit") && this.rows[0] && this.mode !== "text") event.target.select();
    },
    left(event) {
      if (!event.target.dataset?.key) return;
      this.flush();
      this.$emit("done", event.target.dataset.key);
      setTimeout(() => this.$el && this.sync());
    },
    remove(what, index) {
      this.flush();
      this.$emit("remove", [what, index]);
    },
    key(event) {
      const field = event.target, key = field.dataset?.key;
      if (!key || event.isComposing) return;
      if (event.key === "Escape" && field.value !== this.before && this.mode !== "range") {
        field.value = this.before;
        this.typed(event);
        event.stopPropagation();
        return;
      }
      if (event.key === "Enter" && this.mode !== "area") this.flush();
      if (!["grid", "entries"].includes(this.mode) || event.altKey || event.metaKey) return;
      if (event.ctrlKey && event.key === "Delete" && key.startsWith("name,") && this.rows.length > 1) {
        event.preventDefault();
        return this.remove(this.rowKind, Number(key.slice(5)));
      }
      const r = Number(field.dataset.r), c = Number(field.dataset.c), last = this.rows.length - 1;
      const collapsed = field.selectionStart === field.selectionEnd, all = field.selectionEnd - field.selectionStart === field.value.length;
      const atStart = (collapsed && field.selectionStart === 0) || all, atEnd = (collapsed && field.selectionEnd === field.value.length) || all;
      let to = null;
      if (event.ctrlKey) {
        if (event.key === "Home") to = [0, 0];
        if (event.key === "End") to = [last, this.rows[last].length - 1];
      } else if (event.key === "ArrowUp" || (event.key === "Enter" && event.shiftKey)) to = [r - 1, c];
      else if (event.key === "ArrowDown" || event.key === "Enter") to = [r + 1, c];
      else if (event.key === "ArrowLeft" && atStart && !event.shiftKey) to = [r, c - 1];
      else if (event.key === "ArrowRight" && atEnd && !event.shiftKey) to = [r, c + 1];
      if (!to) return;
      event.preventDefault();
      const next = this.$el.querySelector(`input[data-r="${to[0]}"][data-c="${to[1]}"]`);
      if (!next) return;
      next.focus();
      next.select();
    },
    pasted(event) {
      const field = event.target, text = event.clipboardData?.getData("text") ?? "";
      const [i, j] = (field.dataset?.key ?? "").split(",").map(Number);
      if (this.mode !== "grid" || !Number.isInteger(i) || !/[\t\n]/.test(text.trim())) return;
      event.preventDefault();
      this.flush();
      const key = field.dataset.key;
      this.sent[key] = ++this.number;
      this.$emit("block", { number: this.number, row: i, column: j, text });
    },
    numberLines(field) {
      if (this.mode !== "area") return;
      const count = field.value.split("\n").length;
      if (count === this.count) return;
      this.count = count;
      this.$refs.gutter.textContent = Array.from({ length: count }, (_, i) => i + 1).join("\n");
    },
    // Called by the page.
    enter(path) {
      const field = path ? this.$el.querySelector(`[data-path="${CSS.escape(path)}"]`) : this.$el.querySelector("[data-key]");
      field?.focus();
      if (this.mode === "area") {
        field.setSelectionRange(0, 0);
        field.scrollTop = 0;
      } else field?.scrollIntoView({ block: "center", inline: "nearest" });
    },
    nameRow(i) {
      const field = this.$el.querySelector(`[data-key="name,${i}"]`);
      field?.focus();
      field?.select();
    },
    line(number) {
      const field = this.$el.querySelector("textarea");
      const lines = field.value.split("\n");
      const start = lines.slice(0, number - 1).join("\n").length + (number > 1 ? 1 : 0);
      field.focus();
      field.setSelectionRange(start, start + (lines[number - 1] ?? "").length);
      field.scrollTop = (number - 5) * parseFloat(getComputedStyle(field).lineHeight);
    },
  },
};
